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

"""The quick way from a stream to the one that answers it, one sample at a time."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from std_msgs.msg import Float64MultiArray

from piezo_ros.model.compiled import Operands, direct
from piezo_ros.runtime.streams.endpoints import StreamReader, StreamWriter

if TYPE_CHECKING:
    from piezo_ros.runtime.node.hooks import NodeHooks

__all__ = ['Relay']


class Relay:
    """
    Answers single samples from message to message in one compiled call.

    Parameters
    ----------
    stage : NodeHooks
        Whose streams they are.
    reader, writer : StreamReader, StreamWriter
        The streams.
    kernel : callable
        One of `piezo_ros.bag.relay_kernels`.
    other : callable
        Does what is to be done with any other message, which `StreamReader.take_rest` hands out;
        returns whether there was anything.

    Attributes
    ----------
    look : callable
        Does what `Stage.look` does, if it is bound. Another one after each `bind`.

    """

    def __init__(
        self, stage: 'NodeHooks', reader: StreamReader, writer: StreamWriter, kernel: Any,
        other: Callable[[], bool],
    ) -> None:
        self._stage = stage
        self._reader, self._writer = reader, writer
        self._kernel = kernel
        self._other = other
        self._answer: Any = None
        self._templates = (
            np.frombuffer(reader.example, np.uint8), np.frombuffer(writer.message, np.uint8),
            writer.copy.recent if writer.copy else np.zeros(1),
            np.frombuffer(reader.counter, np.int64), np.frombuffer(writer.counter, np.int64))
        self.look: Callable[[int], bool] = stage.look

    def bind(self, *operands: Any) -> None:
        """Give the kernel its operands, those before the messages."""
        self._operands = Operands(*operands, *self._templates)
        places = self._operands.places
        self._answer = self._answer or direct(self._kernel, places, b'')
        self.look = self._make_look(self._answer, places)

    def _make_look(self, answer: Any, places: NDArray[np.int64]) -> Callable[[int], bool]:
        """Return `look`; a closure, since finding its parts would take as long as its work."""
        stage, reader, writer, other = self._stage, self._reader, self._writer, self._other
        take_message, message_type = reader.subscription.handle.take_message, Float64MultiArray
        outlet, message = writer.outlet, writer.message
        publish_raw, not_taken = outlet.publish_raw, _rclpy.RCLError
        copy, counter = writer.copy, writer.counter
        sched_yield = os.sched_yield
        held = reader.held

        def look(times: int) -> bool:
            if held:  # What came before the run goes first.
                return stage.look(times)
            taken = take_message(message_type, True)
            while taken is None:
                times -= 1
                if times <= 0 or stage.stop_requested:
                    return False
                sched_yield()
                taken = take_message(message_type, True)
            if answer(places, taken[0]):
                try:
                    publish_raw(message)
                except not_taken:
                    outlet.publish_patiently(message, counter[0] - 1)
                if copy and counter[0] == copy.due:
                    copy.flush(copy.due)
                return True
            reader.raw = taken[0]
            return other()

        return look
