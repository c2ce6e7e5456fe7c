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

"""A controller of one's own: v[k] = v[k-1] + g (y_d[k] - y[k]), by typed messages."""

import json
import math
import time
from collections import deque

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String, UInt64

STREAM = QoSProfile(history=HistoryPolicy.KEEP_ALL)  # reliable and volatile by default
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LOOKAHEAD = 1000


class Input:
    """One stream that the controller reads: its samples in order, from index 0."""

    def __init__(self, node, topic):
        self.node, self.topic = node, topic
        self.index, self.ended, self.queue = 0, False, deque()
        self.subscription = node.create_subscription(
            Float64MultiArray, topic, self.on_block, STREAM)

    def on_block(self, message):
        layout, data = message.layout, message.data
        count = len(data) - 2
        wanted = [(f'{self.topic}_um', count, count)]
        if self.ended or count < 0 or not all(map(math.isfinite, data)) or (
                [(d.label, d.size, d.stride) for d in layout.dim] != wanted
                or layout.data_offset != 2 or data[1] <= 0.0
                or data[0] != int(data[0]) or data[0] < self.index):
            self.node.get_logger().warning(f'refused a block of {self.topic}: {list(data[:3])} …')
        elif data[0] > self.index or data[1] != self.node.sample_period_s:
            self.node.end('faulted', f'{self.topic}: {list(data[:2])} where {self.index} is due')
        else:
            self.queue += data[2:]
            self.index, self.ended = self.index + count, count == 0
            self.node.step()


class IntegralController(Node):
    """Sends v[k] once y_d[k] and y[k] are there; takes the feedforward, and leaves it at that."""

    def __init__(self):
        super().__init__('controller')
        for name, default in {
                'gain': 0.02, 'sample_period_s': 1e-5, 'required_readers': 1}.items():
            setattr(self, name, self.declare_parameter(name, default).value)
        self.state, self.index, self.command_um, self.command_ended = 'inactive', 0, 0.0, False
        self.command = self.create_publisher(Float64MultiArray, 'command', STREAM)
        self.demand = self.create_publisher(UInt64, 'demand', LATCHED)
        self.status = self.create_publisher(String, 'status', LATCHED)
        self.inputs = self.reference, self.feedforward, self.displacement = [
            Input(self, topic) for topic in ('reference', 'feedforward', 'displacement')]
        self.create_timer(0.1, self.watch)

    def watch(self):
        writers = [source.subscription.get_publisher_count() for source in self.inputs]
        if self.state == 'inactive' and writers == [1, 1, 1] and (
                self.command.get_subscription_count() >= self.required_readers):
            self.report('active', '')
            self.demand.publish(UInt64(data=LOOKAHEAD))
        elif self.state == 'active':
            for source, count in zip(self.inputs, writers, strict=True):
                if count > 1 or (count == 0 and not source.ended):
                    self.end('faulted', f'{source.topic} has {count} writers')

    def step(self):
        self.feedforward.queue.clear()
        commands = []
        while self.reference.queue and self.displacement.queue and not self.command_ended:
            error_um = self.reference.queue.popleft() - self.displacement.queue.popleft()
            self.command_um += self.gain * error_um
            commands.append(self.command_um)
        if commands:
            self.send(self.index, commands)
            self.index += len(commands)
            self.demand.publish(UInt64(data=self.index + LOOKAHEAD))
        if self.reference.ended and not self.reference.queue and not self.command_ended:
            self.send(self.index, [])
            self.command_ended = True
        if self.displacement.ended and self.state == 'active':
            self.end('finished' if self.command_ended else 'faulted', '')

    def send(self, index, samples):
        message = Float64MultiArray(data=[float(index), self.sample_period_s, *samples])
        message.layout.data_offset = 2
        message.layout.dim = [MultiArrayDimension(
            label='command_um', size=len(samples), stride=len(samples))]
        self.command.publish(message)

    def end(self, state, reason):
        if not self.command_ended:
            self.send(self.index, [])
            self.command_ended = True
        self.report(state, reason)

    def report(self, state, reason):
        self.state = state
        self.status.publish(String(data=json.dumps({
            'node': 'controller', 'state': state, 'index': self.index, 'reason': reason})))


def main():
    # Without rclpy's own handler, which would end the middleware before the last word is sent.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    controller = IntegralController()
    try:
        while controller.state in ('inactive', 'active'):
            rclpy.spin_once(controller)
        time.sleep(1.0)  # so that the status can still be read
    except KeyboardInterrupt:
        controller.end('stopped', 'SIGINT')
        controller.command.wait_for_all_acked()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
