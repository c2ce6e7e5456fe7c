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

"""
The quick way from message to message: one compiled call for each sample of a loop.

A call of Python costs more than the mathematics of an element. Where an element is compiled, the
kernel here looks whether a message is simply the next sample of its stream, alone in its block;
if so, it does the element's step and writes the answer over the message before. Anything else is
left as it is, for the node to look at closely.
"""

import os
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Float64MultiArray

from piezo_ros.model.compiled import brief_kernel
from piezo_ros.model.step import step
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.streams.reader import StreamReader
from piezo_ros.runtime.streams.writer import StreamWriter

__all__ = ['Relay', 'RelayedElement']

# Index, sample period and sample are the last three numbers of a message.
_INDEX, _PERIOD, _SAMPLE = 24, 16, 8


class RelayedElement(Protocol):
    """A compiled element that can do one sample."""

    memory: NDArray[np.float64]

    @property
    def sample_step(self) -> Callable[..., float]:
        """
        A marked step, see `piezo_ros.model.step`.

        It takes the memory; what goes with the samples, shape (rows, M), and the place in it; the
        number of the sample; and the sample. It returns the answer.
        """


@step
def _number(raw: Any, at: int) -> Any:
    """Return the little-endian double at a place that need not be aligned."""
    bits = np.uint64(
        np.uint64(raw[at])
        | np.uint64(raw[at + 1]) << np.uint64(8)
        | np.uint64(raw[at + 2]) << np.uint64(16)
        | np.uint64(raw[at + 3]) << np.uint64(24)
        | np.uint64(raw[at + 4]) << np.uint64(32)
        | np.uint64(raw[at + 5]) << np.uint64(40)
        | np.uint64(raw[at + 6]) << np.uint64(48)
        | np.uint64(raw[at + 7]) << np.uint64(56))
    return bits.view(np.float64)


@step
def _put(message: Any, at: int, value: float) -> None:
    number = np.float64(value)
    bits = number.view(np.uint64)
    for byte in range(8):
        message[at + byte] = (bits >> np.uint64(8 * byte)) & np.uint64(255)


@step
def _is_next(raw: Any, expected: Any, index: int) -> bool:
    """Return whether a message is one finite sample of this index, all else as expected."""
    size = len(expected)
    if len(raw) != size:
        return False
    # Without a way out in the middle, so that many bytes are compared at once.
    difference = np.uint8(0)
    for at in range(size - _INDEX):
        difference |= raw[at] ^ expected[at]
    for at in range(size - _PERIOD, size - _SAMPLE):
        difference |= raw[at] ^ expected[at]
    if difference != 0:
        return False
    sample = _number(raw, size - _SAMPLE)
    is_next: bool = _number(raw, size - _INDEX) == index and sample - sample == 0.0
    return is_next


@cache
def _relay_kernel(sample_step: Callable[..., float]) -> Callable[..., bool]:
    """Return the compiled answer of an element from message to message."""

    @brief_kernel
    def relay(
        raw: bytes, expected: Any, message: Any, recent: Any, memory: Any, beside: Any, at: int,
        k: int, index: int, answer_index: int,
    ) -> bool:
        if beside.shape[0] and not 0 <= at < beside.shape[1]:
            return False
        if not _is_next(raw, expected, index):
            return False
        value = sample_step(memory, beside, at, k, _number(raw, len(raw) - _SAMPLE))
        recent[answer_index % len(recent)] = value
        _put(message, len(message) - _INDEX, answer_index)
        _put(message, len(message) - _SAMPLE, value)
        return True

    return relay


class Relay:
    """
    Answers single samples of a stream as long as they are simply the next.

    Parameters
    ----------
    node : LoopNode
        Whose streams they are.
    reader, writer : StreamReader, StreamWriter
        The stream and its answers; a run has begun on both.
    element : RelayedElement
        What answers.
    other : callable
        Does what is to be done with any other message, which `StreamReader.take_rest` hands out;
        returns whether there was anything.

    """

    def __init__(
        self, node: LoopNode, reader: StreamReader, writer: StreamWriter, element: RelayedElement,
        other: Callable[[], bool],
    ) -> None:
        self._node = node
        self.use(0, np.empty((0, 0)))
        self.look = self._make_look(reader, writer, element, other)

    def use(self, first: int, beside: NDArray[np.float64], origin: int = 0) -> None:
        """
        Take what goes with the samples from an index on.

        Parameters
        ----------
        first : int
            The index.
        beside : ndarray of float64, shape (rows, M)
            What the element needs beside the samples first … first+M-1, of which alone some are
            answered then; no rows where it needs nothing.
        origin : int, optional
            Index of the sample that the element counts as its sample 0.

        """
        self._first, self._beside, self._origin = first, beside, origin

    def _make_look(
        self, reader: StreamReader, writer: StreamWriter, element: RelayedElement,
        other: Callable[[], bool],
    ) -> Callable[[int], bool]:
        """Return `look`; a closure, since finding its parts would take as long as its work."""
        take_message, message_type = reader.subscription.handle.take_message, Float64MultiArray
        answer, memory = _relay_kernel(element.sample_step), element.memory
        expected = np.frombuffer(reader.example(), np.uint8)
        message, copy = writer.message, writer.copy
        own = np.frombuffer(message, np.uint8)
        recent = copy.recent if copy else np.zeros(1)
        publish, sched_yield, node = writer.outlet.publish, os.sched_yield, self._node
        # Loaded, or compiled, before the first sample.
        answer(b'', expected, own, recent, memory, self._beside, 0, 0, 0, 0)

        def look(times: int) -> bool:
            taken = take_message(message_type, True)
            while taken is None:
                times -= 1
                if times <= 0 or node.stop_requested:
                    return False
                sched_yield()
                taken = take_message(message_type, True)
            index, answer_index = reader.next_index, writer.next_index
            if answer(
                taken[0], expected, own, recent, memory, self._beside, index - self._first,
                index - self._origin, index, answer_index,
            ):
                reader.next_index = index + 1
                publish(message, answer_index)
                writer.next_index = answer_index = answer_index + 1
                if copy and answer_index == copy.due:
                    copy.flush(answer_index)
                return True
            reader.raw = taken[0]
            return other()

        return look
