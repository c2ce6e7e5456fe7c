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

"""Controllers that break the contract, each in one way: `wrong_controller.py WAY --ros-args …`."""

import runpy
import sys
import time
from pathlib import Path

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

EXAMPLE = runpy.run_path(
    str(Path(__file__).parents[2] / 'docs' / 'examples' / 'integral_controller.py'))
IntegralController = EXAMPLE['IntegralController']


class NeverDemands(IntegralController):
    def create_publisher(self, message_type, topic, qos):
        return super().create_publisher(
            message_type, 'wishes' if topic == 'demand' else topic, qos)


class DemandsOnceAndForAll(IntegralController):
    """In a way that nobody hears who comes later."""

    def create_publisher(self, message_type, topic, qos):
        return super().create_publisher(
            message_type, topic, QoSProfile(depth=1) if topic == 'demand' else qos)


class AnswersTwice(IntegralController):
    def send(self, index, samples):
        super().send(index + self.index, samples * 2)


class WaitsForTheNextMeasurement(IntegralController):
    def step(self):
        if self.displacement.index > self.index + 1 or self.reference.ended:
            super().step()


if __name__ == '__main__':
    way = sys.argv.pop(1)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    controller = globals()[way]()
    try:
        while controller.state in ('inactive', 'active'):
            rclpy.spin_once(controller)
        time.sleep(60.0)
    except KeyboardInterrupt:
        pass
