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

"""The relay of the controller: single readings are answered in compiled code where targets wait."""

from collections.abc import Callable

import numpy as np

from piezo_ros.control.control_law import ControlLaw
from piezo_ros.control.pi_controller import PiController
from piezo_ros.nodes.controller_parts.controller_inputs import ControllerInputs
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.relay import Relay
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = ['TargetRelay']

_WORTH_RELAYING = 4  # samples; for fewer the relay costs more than it saves
_MOST_RELAYED = 4096  # samples, the targets of which are laid out for it at once


class TargetRelay:
    """
    Hands the targets that wait to a `Relay`, and drops those that it has used.

    Parameters
    ----------
    node : LoopNode
        The controller.
    inputs : ControllerInputs
        Its inputs.
    command : StreamWriter
        Its commands.
    law : ControlLaw
        Its law; none but a compiled `PiController` can be relayed.
    other : callable
        What the node does with a message that the relay has taken and not used.

    """

    def __init__(
        self, node: LoopNode, inputs: ControllerInputs, command: StreamWriter, law: ControlLaw,
        other: Callable[[], bool],
    ) -> None:
        self._inputs = inputs
        self._command = command
        self._relay = (
            Relay(node, inputs.displacement, command, law, other)
            if isinstance(law, PiController) and law.is_compiled else None)

    def begin(self, most: int) -> None:
        """Relay the next samples, `most` at most, if enough targets and no readings wait."""
        inputs = self._inputs
        displacement = inputs.displacement
        if not self._relay or not inputs.closes_loop or displacement.held or displacement.queue:
            return
        count = inputs.count_targets(min(most, _MOST_RELAYED))
        if count < _WORTH_RELAYING:
            return
        target_um = np.zeros((2, count))
        for row, reader in enumerate(inputs.targets):
            target_um[row] = reader.queue.waiting[:count]
        self._relay.begin(self._command.next_index, target_um, inputs.first)

    def end(self) -> None:
        """Go back to the node's own way, and drop the targets that the relay has used."""
        if self._relay and self._relay.end():
            for reader in self._inputs.targets:
                reader.drop_before(self._command.next_index)
