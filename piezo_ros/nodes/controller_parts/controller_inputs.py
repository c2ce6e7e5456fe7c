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

"""The three inputs of the controller, paired by index: which samples wait, which are dropped."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.control_law import ControlLaw
from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.nodes.controller_parts.input_alignment import (
    begin_feedforward,
    join_streams,
    recall_displacement,
)
from piezo_ros.runtime.streams.bursts import BURST_BLOCKS, MOST_JOINED
from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = ['ControllerInputs']


class ControllerInputs:
    """
    Reference, feedforward and displacement; a command needs one sample of each of its own index.

    An input that the scheme does not use is taken too, and dropped up to the next command.
    Otherwise its writer would wait for this reader.

    Parameters
    ----------
    readers : mapping of str to StreamReader
        The three streams by name; a run has begun on them.
    command : StreamWriter
        The commands. The index of the next one is that of the samples that are needed next.
    law : ControlLaw
        Is given the latest readings when it begins to use feedback during the run.
    parameters : ControllerParameters
        What the law has at the first sample; the scheme decides which inputs are needed.
    start_index : int
        Index of the first sample; -1 for the first one that all needed inputs have.

    Attributes
    ----------
    first : int
        Index of the first sample of the run.
    closes_loop, feeds_forward : bool
        Whether the scheme needs displacement and feedforward.
    targets : tuple of StreamReader
        The streams of the trajectory that the scheme needs.
    is_ready : bool
        Whether the next sample can be paired; if not, `prepare` must be called first.

    """

    def __init__(
        self, readers: Mapping[str, StreamReader], command: StreamWriter, law: ControlLaw,
        parameters: ControllerParameters, start_index: int,
    ) -> None:
        self.reference = readers['reference']
        self.feedforward = readers['feedforward']
        self.displacement = readers['displacement']
        self.first = max(start_index, 0)
        self._command = command
        self._law = law
        self._use(parameters)
        self._await([self._join] if start_index < 0 else [])

    @property
    def index(self) -> int:
        """Number of the next sample, from the first one of the run on."""
        return self._command.next_index - self.first

    def _use(self, parameters: ControllerParameters) -> None:
        self.closes_loop = parameters.uses_feedback
        self.feeds_forward = parameters.uses_feedforward
        self.targets = (
            (self.reference, self.feedforward) if self.feeds_forward else (self.reference,))

    def change(self, parameters: ControllerParameters) -> None:
        """Pair what another scheme needs, from the next sample on."""
        had_feedback, fed_forward = self.closes_loop, self.feeds_forward
        self._use(parameters)
        index = self._command.next_index
        steps: list[Callable[[], bool]] = []
        if self.feeds_forward and not fed_forward:
            steps.append(lambda: begin_feedforward(self.feedforward, index))
        if self.closes_loop and not had_feedback:
            steps.append(
                lambda: recall_displacement(self.displacement, index, self.first, self._law))
        self._await(steps)

    def _await(self, steps: Sequence[Callable[[], bool]]) -> None:
        self._steps = steps
        self.is_ready = not steps

    def prepare(self) -> bool:
        """
        Do what must be done before the next sample can be paired; return whether all of it is.

        Raises
        ------
        StreamFault
            If samples that a new scheme needs will not come any more.

        """
        if all(step() for step in self._steps):
            self._await([])
        return self.is_ready

    def _join(self) -> bool:
        """Begin the run at the first sample that all needed inputs have; return whether it came."""
        readers = [self.reference]
        if self.closes_loop:
            readers.append(self.displacement)
        if self.feeds_forward:
            readers.append(self.feedforward)
        first = join_streams(readers)
        if first is None:
            return False
        self.first = first
        self._command.begin_at(first)
        return True

    def take(self) -> bool:
        """Take what has come; return whether there was anything."""
        if self.closes_loop:
            progress = not self.displacement.queue and self.displacement.fill()
            most = 1
        else:
            progress = self._take_displacement()
            most = BURST_BLOCKS
        for reader in self.targets:
            if not reader.queue and reader.fill_many(most):
                progress = True
                if not self.feeds_forward:
                    while self.feedforward.take_from(self._command.next_index):
                        pass
        return progress

    def take_left(self) -> bool:
        """Do as `take`, after the displacement that the relay has taken and not used."""
        samples = self.displacement.take_rest()
        if samples is not None:
            self.displacement.queue.extend(samples)
        return self.take() or samples is not None

    def take_after_end(self) -> bool:
        """Take and drop what comes once every command is sent; return whether anything came."""
        progress = self.displacement.fill()
        self.displacement.queue.clear()
        if not self.feedforward.ended:
            progress = self.feedforward.take_from(self._command.next_index) or progress
        return progress

    def _take_displacement(self) -> bool:
        """Take what has come of the displacement; only the newest samples are of interest."""
        # A scheme that is to come may ask for the last measurements before its first sample. Played
        # from a bag it may be there, end and all, before anything is commanded: what cannot be an
        # answer yet stays where it is.
        displacement, commanded = self.displacement, self._command.next_index
        wanted = commanded - self._law.recalled_samples
        taken = 0
        while taken < BURST_BLOCKS and displacement.next_index <= commanded:
            if not displacement.take_from(wanted):
                break
            taken += 1
        return taken > 0

    def count(self, most: int) -> int:
        """Return the number of samples, limited to `most`, for which all inputs are there."""
        count = self.count_targets(most)
        if self.closes_loop:
            count = min(count, len(self.displacement.queue))
        return min(count, MOST_JOINED)

    def count_targets(self, most: int) -> int:
        """Return the number of samples, limited to `most`, for which the targets are there."""
        return min(most, *[len(reader.queue) for reader in self.targets])

    def pull(self, count: int) -> tuple[NDArray[np.float64], ...]:
        """Return the next samples of reference, feedforward and displacement, zeros if unused."""
        unused = np.zeros(count)
        return (
            self.reference.queue.pull(count),
            self.feedforward.queue.pull(count) if self.feeds_forward else unused,
            self.displacement.queue.pull(count) if self.closes_loop else unused)
