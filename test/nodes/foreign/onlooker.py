"""A plain reader of one stream in a process of its own: says what it got, at the end in sum."""

import sys

import rclpy
from rclpy.qos import QoSHistoryPolicy, QoSProfile
from std_msgs.msg import Float64MultiArray

topic, say_every = sys.argv[1], int(sys.argv[2])
rclpy.init(args=sys.argv)
node = rclpy.create_node('onlooker')
samples = []
ended = False


def take(message):
    global ended
    index, _, *values = message.data
    assert index == len(samples), f'sample {index} after {len(samples)}'
    samples.extend(values)
    ended = not values
    if ended or len(samples) % say_every == 0:
        print(f'{len(samples)} samples, sum {sum(samples)!r}', flush=True)


node.create_subscription(
    Float64MultiArray, topic, take, QoSProfile(history=QoSHistoryPolicy.KEEP_ALL))
print('ready', flush=True)
while not ended:
    rclpy.spin_once(node)
print('the end', flush=True)
