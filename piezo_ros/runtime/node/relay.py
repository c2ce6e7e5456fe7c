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

A call of Python costs more than the mathematics of an element. Where an element is compiled, a
kernel looks whether a message is simply the next sample of its stream, alone in its block; if so,
it does the element's step and writes the answer over the message before. Anything else is left as
it is, for the node to look at closely.
"""

import os
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.streams.stream_reader import NO_BYTES, StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter
from piezo_ros.streams import BlockCodec

__all__ = ['Relay', 'RelayedElement']

_NOTHING = np.empty((0, 0))


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


class Relay:
    """
    Answers single samples of a stream as long as they are simply the next.

    Parameters
    ----------
    node : NodeHooks
        The node that has the streams; its `quick` is what the stream loop calls.
    reader, writer : StreamReader, StreamWriter
        The stream and its answers; a run has begun on both.
    element : RelayedElement
        What answers.
    other : callable
        Does what is to be done with any other message, which `StreamReader.take_rest` hands out;
        returns whether there was anything.

    """

    def __init__(
        self, node: NodeHooks, reader: StreamReader, writer: StreamWriter, element: RelayedElement,
        other: Callable[[], bool],
    ) -> None:
        self._node = node
        self._first, self._beside, self._origin = 0, _NOTHING, 0
        self._look = self._make_look(reader, writer, element, other)

    def begin(self, first: int, beside: NDArray[np.float64] = _NOTHING, origin: int = 0) -> None:
        """
        Let the stream loop answer by this relay from now on.

        Parameters
        ----------
        first : int
            The index of the next sample.
        beside : ndarray of float64, shape (rows, M), optional
            What the element needs beside the samples first … first+M-1, of which alone some are
            answered then; no rows where it needs nothing.
        origin : int, optional
            Index of the sample that the element counts as its sample 0.

        """
        self._first, self._beside, self._origin = first, np.ascontiguousarray(beside), origin
        self._node.quick = self._look

    def end(self) -> bool:
        """Let the stream loop poll the node again; return whether it did not."""
        if self._node.quick is not self._look:
            return False
        self._node.quick = self._node.look
        return True

    def _make_look(
        self, reader: StreamReader, writer: StreamWriter, element: RelayedElement,
        other: Callable[[], bool],
    ) -> Callable[[int], bool]:
        """Return what the stream loop calls; a closure, as finding its parts takes long."""
        # Late, for a node that is not compiled does without numba.
        from piezo_ros.runtime.node.relay_kernel import relay_kernel
        take_message, message_type = reader.subscription.handle.take_message, Float64MultiArray
        memory = element.memory
        expected = np.frombuffer(
            BlockCodec(reader.stream).encode(0, reader.sample_period_s or 0.0, [0.0]), np.uint8)
        message, copy = writer.message, writer.copy
        own = np.frombuffer(message, np.uint8)
        recent = copy.recent if copy else np.zeros(1)
        publish, sched_yield, node = writer.outlet.publish, os.sched_yield, self._node
        # Loaded, or compiled, before the first sample.
        answer = relay_kernel(
            element.sample_step, b'', expected, own, recent, memory, self._beside, 0, 0, 0, 0)

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
            reader.raw = taken[0] or NO_BYTES
            return other()

        return look
