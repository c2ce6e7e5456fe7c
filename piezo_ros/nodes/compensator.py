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

"""The compensator: linearised command in, voltage out, through the inverse MRC model."""

from piezo_ros.model import HysteresisParameters, InverseHysteresis
from piezo_ros.nodes.bursts import answer_waiting
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage

__all__ = ['Compensator']


class Compensator(Stage):
    """Answers every block of ``command`` with a block of ``voltage``."""

    inputs = ('command',)
    outputs = ('voltage',)

    def __init__(self, *, compiled: bool = False) -> None:
        super().__init__('compensator', compiled=compiled)

    def configure(self) -> None:
        """Read the hysteresis to invert."""
        self._hysteresis = read(self, HysteresisParameters)

    def start(self) -> None:
        """Assume a virgin stage."""
        self._inverse = InverseHysteresis(self._hysteresis, compiled=self.settings.compiled)
        self._command = self.readers['command']
        self._voltage = self.writers['voltage']

    def poll(self) -> bool:
        """Answer what waits."""
        longest = answer_waiting(self._command, self._voltage, self._inverse.answer)
        if longest:
            self.in_blocks = longest > 1
        if self._command.ended:
            self.finish()
        return longest > 0 or self._command.ended
