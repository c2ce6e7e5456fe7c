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

"""Plants that break the contract in one way or several: `wrong_plant.py A+B --ros-args …`."""

import math
import runpy
import sys
import time
from pathlib import Path

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

EXAMPLE = runpy.run_path(
    str(Path(__file__).parents[2] / 'docs' / 'examples' / 'gain_plant.py'))
GainPlant = EXAMPLE['GainPlant']


class OpensWithTwo(GainPlant):
    def send(self, index, samples):
        super().send(index, [0.0, 0.0] if index == 0 else samples)


class NeverOpens(GainPlant):
    def send(self, index, samples):
        if index:
            super().send(index, samples)


class AnswersWithTheSameIndex(GainPlant):
    def send(self, index, samples):
        super().send(max(index - 1, 0) if samples else index, samples)


class ForgetsTheOffset(GainPlant):
    def send(self, index, samples):
        publish = self.displacement.publish
        self.displacement.publish = lambda message: publish(
            Float64MultiArray(data=message.data))
        super().send(index, samples)
        del self.displacement.publish


class TakesAnything(GainPlant):
    """Looks at neither the numbers nor the layout."""

    def on_voltage(self, message):
        _, _, *samples = message.data if len(message.data) > 1 else [0.0, 0.0, 0.0]
        if samples:
            self.index += len(samples)
            self.send(self.index - len(samples) + 1, [
                u if math.isfinite(u) else 0.0 for u in samples])
        else:
            self.end('finished', '')


class RemembersWhatItRefuses(GainPlant):
    def on_voltage(self, message):
        before = self.index
        super().on_voltage(message)
        if self.index == before and self.state == 'active':
            self.voltage_v[-1] += 1.0


class ChangesThePeriod(GainPlant):
    def send(self, index, samples):
        right, self.sample_period_s = (
            self.sample_period_s, self.sample_period_s * (2.0 if index > 20 else 1.0))
        super().send(index, samples)
        self.sample_period_s = right


class EndsAtTheWrongIndex(GainPlant):
    def send(self, index, samples):
        super().send(index if samples else index - 1, samples)


class NeverEnds(GainPlant):
    def send(self, index, samples):
        if samples:
            super().send(index, samples)


class SaysNothingOfItself(GainPlant):
    def report(self, state, reason):
        self.state = state


class StaysWhereItIs(GainPlant):
    """Leaves the voltage at its last value."""

    def report(self, state, reason):
        if state not in ('inactive', 'active'):
            self.voltage_v = [0.25]
        super().report(state, reason)


class BestEffort(GainPlant):
    def create_publisher(self, message_type, topic, qos):
        if topic == 'displacement':
            qos = QoSProfile(
                history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.BEST_EFFORT)
        return super().create_publisher(message_type, topic, qos)


class JumpsOverGaps(GainPlant):
    def on_voltage(self, message):
        if len(message.data) > 2 and message.data[0] > self.index:
            message.data[0] = float(self.index)
        super().on_voltage(message)


class WatchesNothing(GainPlant):
    def watch(self):
        if self.state == 'inactive':
            super().watch()


class DiesOnNonsense(GainPlant):
    def on_voltage(self, message):
        assert message.layout.dim[0].label == 'voltage_v'
        super().on_voltage(message)


if __name__ == '__main__':
    ways = sys.argv.pop(1).split('+')
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    plant = type('WrongPlant', tuple(globals()[way] for way in ways), {})()
    try:
        while plant.state in ('inactive', 'active'):
            rclpy.spin_once(plant)
        time.sleep(60.0)
    except KeyboardInterrupt:
        pass
