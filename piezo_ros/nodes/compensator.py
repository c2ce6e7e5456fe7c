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

"""The compensator: linearised command in, voltage out, through the inverse creep and MRC model."""

from piezo_ros.model import CompensatorParameters, InverseHysteresis
from piezo_ros.runtime.node.answering import AnsweringNode
from piezo_ros.runtime.node.declared_parameters import read

__all__ = ['Compensator']


class Compensator(AnsweringNode):
    """Answers every block of ``command`` with a block of ``voltage``."""

    inputs = ('command',)
    outputs = ('voltage',)

    def __init__(self, *, compiled: bool = False) -> None:
        super().__init__('compensator', compiled=compiled)

    def configure(self) -> None:
        """Read the hysteresis, and the creep, to invert."""
        self._inverted = read(self, CompensatorParameters)

    def make_element(self) -> InverseHysteresis:
        """Return the inverse of a virgin stage."""
        self._inverse = InverseHysteresis(
            self._inverted, self.settings.sample_period_s, compiled=self.settings.compiled)
        return self._inverse

    def relayed(self) -> InverseHysteresis | None:
        """Return the inverse if it is compiled."""
        return self._inverse if self._inverse.is_compiled else None
