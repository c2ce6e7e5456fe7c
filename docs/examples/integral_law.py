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

"""A controller of one's own: v[k] = v[k-1] + g Ts (y_d[k] - y[k]), as one class with one method."""

import sys

import numpy as np

from piezo_ros.control import ControlLaw
from piezo_ros.nodes.executables import run_controller


class IntegralLaw(ControlLaw):
    """Integrates the error with the gain of the parameter ``integral_gain_per_s``."""

    command_um = 0.0

    def answer(self, index, reference_um, feedforward_um, displacement_um):
        gain = self.parameters.integral_gain_per_s * self.sample_period_s
        command_um = self.command_um + gain * np.cumsum(reference_um - displacement_um)
        self.command_um = command_um[-1]
        return command_um


if __name__ == '__main__':
    sys.exit(run_controller(IntegralLaw))
