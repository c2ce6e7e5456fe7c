"""The quick way from a stream to the one that answers it, one sample at a time."""

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from std_msgs.msg import Float64MultiArray

from piezo_ros.model.compiled import Operands, direct
from piezo_ros.nodes.streams import StreamReader, StreamWriter

__all__ = ['Relay']


class Relay:
    """
    Answers single samples from message to message in one compiled call.

    Parameters
    ----------
    reader, writer : StreamReader, StreamWriter
        The streams.
    kernel : callable
        One of `piezo_ros.bag.relay_kernels`.
    other : callable
        Does what is to be done with any other message, which `StreamReader.take_other` hands out;
        returns whether there was anything.

    Attributes
    ----------
    poll : callable
        Answers one message; returns whether there was anything.

    """

    def __init__(
        self, reader: StreamReader, writer: StreamWriter, kernel: Any, other: Callable[[], bool],
    ) -> None:
        self._kernel = kernel
        self._other = other
        self._answer: Any = None
        self._templates = (
            np.frombuffer(reader.example, np.uint8), np.frombuffer(writer.message, np.uint8),
            writer.copy.recent if writer.copy else np.zeros(1))
        self.poll = self._make_poll(reader, writer)

    def bind(self, *operands: Any) -> None:
        """Give the kernel its operands, those before the messages."""
        self._operands = Operands(*operands, *self._templates)
        self._places = self._operands.places
        self._answer = self._answer or direct(self._kernel, self._places, b'', 0, 0)

    def _make_poll(self, reader: StreamReader, writer: StreamWriter) -> Callable[[], bool]:
        """Return `poll`; a closure, since looking its parts up would take as long as its work."""
        take_message = reader.subscription.handle.take_message
        outlet, message, copy = writer.outlet, writer.message, writer.copy
        publish_raw, other, message_type = outlet.publish_raw, self._other, Float64MultiArray
        not_taken = _rclpy.RCLError

        def poll() -> bool:
            taken = take_message(message_type, True)
            if taken is None:
                return False
            raw = taken[0]
            index = writer.next_index
            if self._answer(self._places, raw, reader.next_index, index):
                try:
                    publish_raw(message)
                except not_taken:
                    outlet.publish_patiently(message, index)
                reader.next_index += 1
                writer.next_index = index = index + 1
                if copy and index == copy.due:
                    copy.flush(index)
                return True
            reader.raw = raw
            return other()

        return poll
