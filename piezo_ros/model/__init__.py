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

"""The rig: hysteresis, linear dynamics, converters, noise, and the whole of them."""

from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import (
    CompensatorParameters,
    InverseHysteresis,
    MaxwellResistiveCapacitor,
)
from piezo_ros.model.parameters import ParameterError, ParameterSet
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

__all__ = [
    'CompensatorParameters',
    'DynamicsParameters',
    'HysteresisParameters',
    'InverseHysteresis',
    'LinearDynamics',
    'MaxwellResistiveCapacitor',
    'ParameterError',
    'ParameterSet',
    'Rig',
    'RigParameters',
]
