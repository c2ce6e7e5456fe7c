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

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.stepping import compensator_stepper, packed_memory
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.parameters import read
from piezo_ros.runtime.streams.bursts import answer_burst

if TYPE_CHECKING:
    from piezo_ros.runtime.streams.relay import Relay

__all__ = ['Compensator']


class Compensator(LoopNode):
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
        compiled = self.settings.compiled
        self._inverse = compensator_stepper(self._hysteresis, compiled=compiled)
        self._command = self.readers['command']
        self._voltage = self.writers['voltage']
        self._relay = self._make_relay() if compiled else None

    def _make_relay(self) -> 'Relay':
        from piezo_ros.bag.relay_kernels import relay_inverse
        from piezo_ros.runtime.streams.relay import Relay
        relay = Relay(self, self._command, self._voltage, relay_inverse, self._poll_other)
        relay.bind(packed_memory(self._inverse))
        return relay

    def poll(self) -> bool:
        """Answer one block."""
        sample = self._command.take_one()
        if sample is None:
            return self._poll_other()
        self.in_blocks = False
        self._voltage.publish_one(self._inverse(sample))
        if self._relay:
            self.quick = self._relay.look
        return True

    def _poll_other(self) -> bool:
        """Answer the blocks that wait."""
        if not self._command.raw:
            return False
        longest = answer_burst(self._command, self._voltage, self._answer)
        if longest:
            self.in_blocks = longest > 1
        if self._command.ended:
            self.finish()
        return longest > 0 or self._command.ended

    def _answer(self, command_um: NDArray[np.float64]) -> list[float] | NDArray[np.float64]:
        if not self.settings.compiled:
            return [self._inverse(sample) for sample in command_um.tolist()]
        from piezo_ros.model.kernels import inverse_packed_array
        voltage_v = np.empty_like(command_um)
        inverse_packed_array(packed_memory(self._inverse), command_um, voltage_v)
        return voltage_v
