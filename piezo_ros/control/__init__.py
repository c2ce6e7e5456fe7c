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

"""Waveforms, feedforward, the PI controller with its schemes, and the loop closed offline."""

from piezo_ros.control.closed_loop import BareRun, ClosedLoopRun, simulate, simulate_bare
from piezo_ros.control.control_law import ControlLaw
from piezo_ros.control.controller_step import SCHEMES, ControllerParameters
from piezo_ros.control.trajectory_step import TrajectoryParameters
from piezo_ros.control.waveform import WAVEFORMS

__all__ = [
    'SCHEMES',
    'WAVEFORMS',
    'BareRun',
    'ClosedLoopRun',
    'ControlLaw',
    'ControllerParameters',
    'TrajectoryParameters',
    'simulate',
    'simulate_bare',
]
