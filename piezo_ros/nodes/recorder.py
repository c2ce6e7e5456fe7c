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

"""The recorder: every block of every stream into a bag, with the parameters of all nodes."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any

from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.bag import BagError, BagWriter
from piezo_ros.nodes.recorder_parts.bag_directories import BagDirectories
from piezo_ros.nodes.recorder_parts.device_status import DeviceStatus
from piezo_ros.nodes.recorder_parts.last_blocks import AT_ONCE, last_blocks
from piezo_ros.nodes.recorder_parts.peer_parameters import PeerParameters
from piezo_ros.nodes.recorder_parts.run_description import RunDescription
from piezo_ros.parameters.node_parameters import RecorderParameters
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_copy import copy_topic

__all__ = ['Recorder']


@contextmanager
def _told_as_fault() -> Iterator[None]:
    """Make a fault of the run of what is wrong with the bag, a block or the parameters."""
    try:
        yield
    except (BagError, ValueError) as error:
        raise StreamFault(str(error)) from None


class Recorder(LoopNode):
    """Writes what arrives; closes the bag when every stream has ended."""

    urgent = False
    in_bursts = True
    subscribes_late = True

    def __init__(self, *, compiled: bool = False) -> None:
        self._bag: BagWriter | None = None
        self._directories = BagDirectories()
        self._parameter_clients: dict[str, AsyncParameterClient] = {}
        super().__init__('recorder', compiled=compiled)

    def configure(self) -> None:
        """Decide where to record; a directory that exists is refused now, not later."""
        self._recording = read(self, RecorderParameters)
        self.inputs = self._recording.stream_names
        self._directory = self._directories.next(self._recording.bag_directory)

    def input_topic(self, stream: str) -> str:
        """Return the topic of a stream, or of its copy."""
        return copy_topic(stream) if self._recording.from_copies else stream

    def create_endpoints(self) -> None:
        """Listen to what a plant tells of its device."""
        self._device = DeviceStatus(self)

    def start(self) -> None:
        """Ask the other nodes for their parameters; the bag begins with them."""
        self._directory = self._directories.next(self._recording.bag_directory)
        self._waited = RunningTime()
        self._waited_at_end: RunningTime | None = None
        self._next_flush_s = time.monotonic() + self._recording.flush_period_s
        self._pending: deque[tuple[str, bytes]] = deque()
        self._peers = PeerParameters(self, self._parameter_client)
        self._description = RunDescription(
            self._directory, self.get_namespace(), self._recording.parameters_file, self._peers,
            self._device, self._recording.bag_namespace)
        self._is_described = False

    def _parameter_client(self, name: str) -> AsyncParameterClient:
        """Return the client of a node's parameters; one for all runs, rclpy cannot give it back."""
        clients = self._parameter_clients
        return clients.get(name) or clients.setdefault(name, AsyncParameterClient(self, name))

    def poll(self) -> bool:
        """Write what has arrived."""
        progress = False
        for stream, reader in self.readers.items():
            for _ in range(AT_ONCE):
                if reader.take_array() is None:
                    break
                self._pending.append((stream, reader.raw))
                progress = True
        if self._bag is None and not self._open():
            return progress
        assert self._bag is not None
        if self._pending:  # A recorder that waits looks very often.
            with _told_as_fault():
                while self._pending:
                    self._bag.write(*self._pending.popleft())
        if not progress and all(reader.ended for reader in self.readers.values()):
            if self._has_all_parameters():
                self.finish()
        return progress

    def _has_all_parameters(self) -> bool:
        """Return whether the nodes have told their parameters, or had the time to."""
        self._describe()
        self._waited_at_end = self._waited_at_end or RunningTime()
        timeout_s = self._recording.parameters_timeout_s
        return not self._peers.owing or self._waited_at_end.elapsed_s() > timeout_s

    def _describe(self, last: bool = False) -> None:
        """Add to the bag what nodes have told of themselves only after it was begun."""
        if self._bag is None or (self._is_described and not last):
            return
        self._is_described = self._peers.complete()
        with _told_as_fault():
            if (self._is_described or last) and (news := self._description.news(last=last)):
                self._bag.describe(*news)

    def watch(self, now_s: float) -> None:
        """Hand what was recorded to the operating system now and then."""
        self._describe()
        if self._bag is not None and now_s >= self._next_flush_s:
            self._next_flush_s = now_s + self._recording.flush_period_s
            with _told_as_fault():
                self._bag.flush()

    def quiesce(self) -> None:
        """Take what is still on its way and close the bag, whatever goes wrong."""
        told = set[str]()
        if self._bag is None:
            self._attempt(told, self._open, True)
        if self._bag is None:
            return
        for block in chain(self._pending, last_blocks(self.readers, self.get_logger().warning)):
            if not self._bag.closed:  # which an error of the disk has done
                self._attempt(told, self._bag.write, *block)
        self._pending.clear()
        if not self._bag.closed:
            self._attempt(told, self._describe, True)
        self._attempt(told, self._bag.close)
        self._bag = None
        self._attempt(told, self._check_peers)

    def _attempt(self, told: set[str], step: Callable[..., Any], *arguments: Any) -> None:
        """Take a step towards the end; its error is noted once, and the next step follows."""
        try:
            step(*arguments)
        except Exception as error:  # The bag must be closed all the same.
            text = f'cannot finish the bag: {str(error) or type(error).__name__}'
            if text not in told:
                self.run.note_fault(text)
            told.add(text)

    def _check_peers(self) -> None:
        for name in self._description.missing():
            self.run.note_fault(
                f'{name} has not told its parameters within '
                f'{self._recording.parameters_timeout_s:g} s; the bag lacks them')

    def _open(self, now: bool = False) -> bool:
        """Open the bag once the parameters are there, or do not come."""
        self._is_described = self._peers.complete()
        is_late = self._waited.elapsed_s() > self._recording.parameters_timeout_s
        if not (now or self._is_described or is_late):
            return False
        for name in self._peers.silent:
            self.get_logger().warning(f'{name} has not told its parameters yet; the bag begins')
        moved = self._description.moved
        with _told_as_fault():
            metadata, parameters = self._description.contents()
            self._bag = BagWriter(
                self._directory, namespace=self._recording.bag_namespace or self.get_namespace(),
                topics={each: moved(self.resolve_topic_name(each)) for each in self.readers},
                metadata=metadata, compression=self._recording.compression)
            self._directories.note_written(self._directory)
            self._bag.attach_parameters(parameters)
        return True

    def status_fields(self) -> dict[str, Any]:
        """Return how much was recorded."""
        return {'index': max((reader.received for reader in self.readers.values()), default=0)}
