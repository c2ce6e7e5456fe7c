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
A foreign peer of one node: writes its inputs, reads its output and its status, by typed messages.

It has a context of its own and no executor: everything is taken from directly.
"""

import json
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String, UInt64

from piezo_ros.bag import STREAMS
from piezo_ros.runtime.process.leaving import destroy_after_others
from piezo_ros.runtime.process.middleware import initialise_rclpy
from piezo_ros.runtime.process.ros_environment import checked_namespace
from piezo_ros.runtime.streams.qos import EVERY_STATUS, LATCHED, STREAM
from piezo_ros.runtime.streams.writer_names import names_of_endpoints
from piezo_ros.streams import Block, MalformedBlockError, block_from_message_fields

__all__ = ['OutputLog', 'Probe', 'block_message', 'wait_for']

_POLL_S: Final = 0.002
_NAME: Final = 'piezo_check'


def wait_for(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Return whether a condition came true in time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if not time.monotonic() <= deadline:  # nor where a time is no number
            return False
        time.sleep(_POLL_S)
    return True


def block_message(
    stream: str, index: float, sample_period_s: float, samples: Sequence[float],
) -> Float64MultiArray:
    """Return a block as any user of rclpy would write it."""
    message = Float64MultiArray()
    message.layout.dim = [MultiArrayDimension(
        label=f'{stream}_{STREAMS[stream]}', size=len(samples), stride=len(samples))]
    message.layout.data_offset = 2
    message.data = [float(index), sample_period_s, *samples]
    return message


class OutputLog:
    """
    What a node has sent on its output, message by message, and what was wrong with it.

    Attributes
    ----------
    samples : list of float
        All samples so far.
    first_index : int or None
        Index of the first of them.
    periods_s : set of float
        Every sample period that a block had.
    ended_at : int or None
        The index of the end (N = 0), once it has come.
    malformed, discontinuous, late : list of str
        What is wrong: blocks that are none, indices that do not follow, blocks behind the end.

    """

    def __init__(self, stream: str) -> None:
        self.samples: list[float] = []
        self.first_index: int | None = None
        self.periods_s: set[float] = set()
        self.ended_at: int | None = None
        self.malformed: list[str] = []
        self.discontinuous: list[str] = []
        self.late: list[str] = []
        self._label = f'{stream}_{STREAMS[stream]}'

    @property
    def heard(self) -> bool:
        """Whether anything has come at all."""
        return bool(self.samples or self.malformed) or self.ended_at is not None

    def note(self, message: Float64MultiArray) -> None:
        """Take one message down."""
        try:
            block = self._block(message)
        except MalformedBlockError as error:
            self.malformed.append(str(error))
            return
        self.periods_s.add(block.sample_period_s)
        if self.ended_at is not None:
            self.late.append(f'block with index {block.index} after the end')
        elif not block.samples:
            self.ended_at = block.index
        else:
            if self.first_index is None:
                self.first_index = block.index
            expected = self.first_index + len(self.samples)
            if block.index != expected:
                self.discontinuous.append(f'index {block.index} where {expected} is due')
            self.samples += block.samples

    def _block(self, message: Float64MultiArray) -> Block:
        if len(message.layout.dim) != 1:
            raise MalformedBlockError(
                f'layout.dim has {len(message.layout.dim)} entries, a block has exactly 1')
        dimension = message.layout.dim[0]
        if dimension.label != self._label:
            raise MalformedBlockError(
                f'layout.dim[0].label is {dimension.label!r}, it must be {self._label!r}')
        index, period_s, samples = block_from_message_fields(
            dimension.label, dimension.size, dimension.stride, message.layout.data_offset,
            np.asarray(message.data))
        return Block(index, period_s, tuple(samples.tolist()))


class Probe:
    """
    The peer of one node, in a namespace.

    Parameters
    ----------
    namespace : str
        Namespace of the node, '' for none.
    output : str
        The stream that the node writes.

    Attributes
    ----------
    log : OutputLog
        What it has written.
    statuses : list of dict
        Every status so far.
    demanded : int
        The newest demand.

    """

    def __init__(self, namespace: str, output: str) -> None:
        namespace = checked_namespace(namespace)
        self._context = Context()
        initialise_rclpy(context=self._context)
        self.node = rclpy.create_node(
            _NAME, namespace=namespace, context=self._context, start_parameter_services=False,
            enable_rosout=False)
        self._output = output
        self.log = OutputLog(output)
        self.statuses: list[dict[str, Any]] = []
        self._status = self.node.create_subscription(String, 'status', _ignore, EVERY_STATUS)
        self._writers: dict[str, Any] = {}
        self._reader: Any = None
        self._demand: Any = None
        self.demanded = 0

    def close(self) -> None:
        """Leave the graph."""
        destroy_after_others(self.node)
        rclpy.try_shutdown(context=self._context)

    def topic(self, name: str) -> str:
        """Return the full name of a topic."""
        return str(self.node.resolve_topic_name(name))

    def writers(self, stream: str) -> list[Any]:
        """Return the endpoint of every writer of a stream but its own."""
        return self._others(self.node.get_publishers_info_by_topic(self.topic(stream)))

    def readers(self, stream: str) -> list[Any]:
        """Return the endpoint of every reader of a stream but its own."""
        return self._others(self.node.get_subscriptions_info_by_topic(self.topic(stream)))

    def problem_of_writers(self, stream: str) -> str:
        """Return '' if a topic has exactly one writer beside this peer, else what is wrong."""
        writers = self.writers(stream)
        if len(writers) == 1:
            return ''
        topic = self.topic(stream)
        if not writers:
            return f'{topic} has no writer, exactly one is needed'
        return (
            f'{topic} has {len(writers)} writers, exactly one is needed: '
            f'{names_of_endpoints(writers)}')

    def _others(self, endpoints: Sequence[Any]) -> list[Any]:
        return [endpoint for endpoint in endpoints if endpoint.node_name != _NAME]

    def open(self, inputs: Sequence[str], *, reliable: bool) -> None:
        """Create the writers of the inputs and the reader of the output."""
        for stream in inputs:
            self._writers[stream] = self.node.create_publisher(Float64MultiArray, stream, STREAM)
        # A best-effort writer matches no reliable reader; what it sends is looked at all the same.
        qos = STREAM if reliable else QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1000,
            reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
        self._reader = self.node.create_subscription(
            Float64MultiArray, self._output, _ignore, qos)

    def read_demand(self) -> None:
        """Listen to the demand, as a trajectory does."""
        self._demand = self.node.create_subscription(UInt64, 'demand', _ignore, LATCHED)

    def connected(self) -> bool:
        """Return whether every writer has its reader and the reader its writer."""
        return bool(self._reader.get_publisher_count()) and all(
            writer.get_subscription_count() for writer in self._writers.values())

    def publish(self, stream: str, message: Float64MultiArray) -> None:
        """Send one message."""
        self._writers[stream].publish(message)

    def second_writer(self, stream: str) -> None:
        """Create a writer beside the one there is."""
        self._writers[f'second {stream}'] = self.node.create_publisher(
            Float64MultiArray, stream, STREAM)

    def close_writer(self, stream: str) -> None:
        """Take the writer of a stream away."""
        self.node.destroy_publisher(self._writers.pop(stream))

    def poll(self) -> None:
        """Take what has arrived."""
        if self._reader is not None:
            while (message := _take(self._reader, Float64MultiArray)) is not None:
                self.log.note(message)
        while (message := _take(self._status, String)) is not None:
            try:
                status = json.loads(message.data)
            except ValueError:
                status = None
            self.statuses.append(status if isinstance(status, dict) else {})
        if self._demand is not None:
            while (message := _take(self._demand, UInt64)) is not None:
                self.demanded = message.data

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Take what arrives until a condition is met; return whether it was."""
        def polled() -> bool:
            self.poll()
            return condition()

        return wait_for(polled, timeout_s)


def _take(subscription: Any, message_type: Any) -> Any:
    taken = subscription.handle.take_message(message_type, False)
    return None if taken is None else taken[0]


def _ignore(_message: Any) -> None:
    """Stand in for the callback that rclpy wants."""
