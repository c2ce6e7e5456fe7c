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

"""A node that answers the samples of one stream by those of another."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.relay import Relay, RelayedElement
from piezo_ros.runtime.streams.bursts import answer_taken, answer_waiting
from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = ['AnsweringNode', 'Element']

_NOTHING = np.empty((0, 0))


class Element(Protocol):
    """The mathematics of a node, with its state."""

    def answer(self, index: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the answers to samples, shape (N,), of which the first has that index."""


class AnsweringNode(LoopNode):
    """Answers every block of its only input with one of its only output, by an element."""

    def make_element(self) -> Element:
        """Return what answers in the run that begins, in its initial state."""
        raise NotImplementedError

    def relayed(self) -> RelayedElement | None:
        """Return the element, if single samples may be answered in compiled code alone."""
        return None

    def beside(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """Return what the relay needs with the sample of an index and later ones, and the first."""
        return 0, _NOTHING

    def start(self) -> None:
        """Make the element anew."""
        self.reader: StreamReader = self.readers[self.inputs[0]]
        self.writer: StreamWriter = self.writers[self.outputs[0]]
        self._element = self.make_element()
        element = self.relayed()
        self._relay = (
            Relay(self, self.reader, self.writer, element, self._poll_taken) if element else None)

    def poll(self) -> bool:
        """Answer what waits."""
        longest = answer_waiting(self.reader, self.writer, self.answer)
        if longest == 1 and self._relay and not self.reader.held:
            self._relay.begin(*self.beside(self.reader.next_index))
        return self._done(longest)

    def answer(self, index: int, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the answers to samples."""
        return self._element.answer(index, samples)

    def after_answer(self) -> None:
        """Do what is to be done after each block and at the end of the stream."""

    def _poll_taken(self) -> bool:
        """Answer the message that the relay has left, and those that wait."""
        if self._relay:
            self._relay.end()
        return self._done(answer_taken(self.reader, self.writer, self.answer))

    def _done(self, longest: int) -> bool:
        if longest:
            self.in_blocks = longest > 1
        elif not self.reader.ended:
            return False
        self.after_answer()
        if self.reader.ended:
            self.finish()
        return True
