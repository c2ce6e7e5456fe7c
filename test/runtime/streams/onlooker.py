# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
