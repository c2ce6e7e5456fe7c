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

"""What a supervisor sees of its rigs beside their statuses: the newest sample of each stream."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Protocol

from std_msgs.msg import Float64MultiArray

from piezo_ros.runtime.node.observation import newest_topic
from piezo_ros.runtime.streams.qos import NEWEST
from piezo_ros.streams.block import MalformedBlockError
from piezo_ros.streams.codec import BlockCodec
from piezo_ros.streams.names import STREAMS

__all__ = ['Observation', 'Observer']


class Observer(Protocol):
    """What is told of the samples and statuses of rigs, each by the name of its axis or ''."""

    def take_sample(self, rig: str, stream: str, index: int, value: float) -> None:
        """Take the newest sample of a stream."""

    def take_status(self, rig: str, status: Mapping[str, Any]) -> None:
        """Take the status of a node."""


class Observation:
    """
    Subscriptions to ``newest/<stream>`` of one rig.

    They are best effort and keep one sample: a supervisor that is busy misses some, and no node
    waits for it.

    Parameters
    ----------
    node : Node
        The node of the supervisor.
    observer : Observer
        What is told.
    rig : str
        Name of the rig, which is that of its namespace below the supervisor's; '' for none.

    """

    def __init__(self, node: Any, observer: Observer, rig: str) -> None:
        self._observer = observer
        self._rig = rig
        place = f'{rig}/' if rig else ''
        self._codecs = {stream: BlockCodec(stream) for stream in STREAMS}
        # An executor that spins the node takes them by the callback, else `take` does.
        self._subscriptions = {
            stream: node.create_subscription(
                Float64MultiArray, f'{place}{newest_topic(stream)}',
                partial(self._note, stream), NEWEST, raw=True)
            for stream in STREAMS}

    def take(self) -> None:
        """Take what has come since the last time, without waiting."""
        for stream, raw in self._taken():
            self._note(stream, raw)

    def drop(self) -> None:
        """Drop what has come since the last time."""
        for _ in self._taken():
            pass

    def _taken(self) -> Any:
        for stream, subscription in self._subscriptions.items():
            while (taken := subscription.handle.take_message(Float64MultiArray, True)) is not None:
                yield stream, taken[0]

    def take_status(self, status: Mapping[str, Any]) -> None:
        """Hand a status on."""
        self._observer.take_status(self._rig, status)

    def _note(self, stream: str, raw: bytes) -> None:
        try:
            block = self._codecs[stream].decode(raw)
        except MalformedBlockError:
            return  # of a stranger
        if block.samples:
            self._observer.take_sample(
                self._rig, stream, block.index + len(block.samples) - 1, block.samples[-1])
