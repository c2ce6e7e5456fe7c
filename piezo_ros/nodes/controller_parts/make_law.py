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

"""The control law of a run: that of the package, or one of the user's own."""

from piezo_ros.control.control_law import ControlLaw
from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.parameters.node_parameters import LoopNodeParameters

__all__ = ['make_law']


def make_law(
    own_law: type[ControlLaw] | None, parameters: ControllerParameters,
    settings: LoopNodeParameters,
) -> ControlLaw:
    """Return the user's own law if there is one, else the PI controller, in its initial state."""
    if own_law:
        return own_law(parameters, settings.sample_period_s)
    return PiController(parameters, settings.sample_period_s, compiled=settings.compiled)
