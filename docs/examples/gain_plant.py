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

"""A plant of one's own in place of the simulated rig: a gain behind a delay, by typed messages."""

import json
import math
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

STREAM = QoSProfile(history=HistoryPolicy.KEEP_ALL)  # reliable and volatile by default
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class GainPlant(Node):
    """Answers u[k] with y[k+1] = gain u[k-delay]; a driver of hardware goes in its place."""

    def __init__(self):
        super().__init__('plant')
        for name, default in {'gain_um_per_v': 1.0, 'delay_samples': 2, 'sample_period_s': 1e-5,
                              'required_readers': 1, 'watchdog_s': 2.0}.items():
            setattr(self, name, self.declare_parameter(name, default).value)
        self.state, self.index, self.heard_s = 'inactive', 0, math.inf
        self.voltage_v = [0.0] * (self.delay_samples + 1)
        self.displacement = self.create_publisher(Float64MultiArray, 'displacement', STREAM)
        self.status = self.create_publisher(String, 'status', LATCHED)
        self.voltage = self.create_subscription(
            Float64MultiArray, 'voltage', self.on_voltage, STREAM)
        self.create_timer(0.1, self.watch)

    def on_voltage(self, message):
        layout, data = message.layout, message.data
        count = len(data) - 2
        if self.state != 'active' or count < 0 or not all(map(math.isfinite, data)) or (
                [(d.label, d.size, d.stride) for d in layout.dim] != [('voltage_v', count, count)]
                or layout.data_offset != 2 or data[1] <= 0.0
                or data[0] != int(data[0]) or data[0] < self.index):
            self.get_logger().warning(f'refused a block: {list(data[:3])} …')
        elif data[0] > self.index or data[1] != self.sample_period_s:
            self.end('faulted', f'index, period {list(data[:2])} where {self.index} is due')
        elif count == 0:
            self.end('finished', '')
        else:
            self.voltage_v += data[2:]
            answers, self.voltage_v = self.voltage_v[1:count + 1], self.voltage_v[count:]
            self.index, self.heard_s = self.index + count, time.monotonic()
            self.send(self.index - count + 1, [self.gain_um_per_v * u for u in answers])

    def send(self, index, samples):
        message = Float64MultiArray(data=[float(index), self.sample_period_s, *samples])
        message.layout.data_offset = 2
        message.layout.dim = [MultiArrayDimension(
            label='displacement_um', size=len(samples), stride=len(samples))]
        self.displacement.publish(message)

    def watch(self):
        writers = self.voltage.get_publisher_count()
        if self.state == 'inactive' and writers == 1 and (
                self.displacement.get_subscription_count() >= self.required_readers):
            self.report('active', '')
            self.send(0, [0.0])
        elif self.state == 'active' and (
                writers != 1 or time.monotonic() - self.heard_s > self.watchdog_s):
            self.end('faulted', f'{writers} writers of voltage, nothing after {self.index}')

    def end(self, state, reason):
        self.voltage_v = [0.0]  # hardware goes there at a limited slew
        self.send(self.index + 1, [])
        self.report(state, reason)

    def report(self, state, reason):
        self.state = state
        self.status.publish(String(data=json.dumps({
            'node': 'plant', 'state': state, 'index': self.index, 'reason': reason,
            'voltage_v': self.voltage_v[-1]})))


def main():
    # Without rclpy's own handler, which would end the middleware before the last word is sent.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    plant = GainPlant()
    try:
        while plant.state in ('inactive', 'active'):
            rclpy.spin_once(plant)
        time.sleep(1.0)  # so that the status can still be read
    except KeyboardInterrupt:
        plant.end('stopped', 'SIGINT')
        plant.displacement.wait_for_all_acked()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
