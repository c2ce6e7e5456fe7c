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

import math
import time
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.bag import BagError, BagWriter
from piezo_ros.experiment.node_parameters import RecorderParameters
from piezo_ros.experiment.provenance import parameters_yaml, run_metadata
from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.parameters import plain, read
from piezo_ros.nodes.stage import Stage
from piezo_ros.nodes.stream_copy import copy_topic
from piezo_ros.nodes.streams import StreamFault

__all__ = ['Recorder']

_ASK_AGAIN_S = 0.5
_AT_ONCE = 64  # blocks of one stream before the next one's turn
_SETTLE_S = 0.2  # how long a stopped recorder waits for what is still on its way
_SETTLE_AT_MOST_S = 2.0  # how long it takes what comes: the others may go on regardless


class Recorder(Stage):
    """Writes what arrives; closes the bag when every stream has ended."""

    urgent = False
    in_bursts = True
    subscribes_late = True

    def __init__(self, *, compiled: bool = False) -> None:
        self._bag: BagWriter | None = None
        self._parameter_clients: dict[str, AsyncParameterClient] = {}
        super().__init__('recorder', compiled=compiled)

    def configure(self) -> None:
        """Decide where to record; a directory that exists is refused now, not later."""
        self._recording = read(self, RecorderParameters)
        self.inputs = self._recording.stream_names
        self._choose_directory()

    def _choose_directory(self) -> None:
        name = self._recording.bag_directory or time.strftime('piezo_%Y_%m_%d-%H_%M_%S')
        self._directory = Path(name).absolute()
        if self._directory.exists():
            raise ParameterError(f'bag_directory {self._directory} exists; it is not overwritten')

    def input_topic(self, stream: str) -> str:
        """Return the topic of a stream, or of its copy."""
        return copy_topic(stream) if self._recording.from_copies else stream

    def start(self) -> None:
        """Ask the other nodes for their parameters; the bag begins with them."""
        self._choose_directory()  # every run has a bag of its own
        self._started_s = time.monotonic()
        self._next_flush_s = self._started_s + self._recording.flush_period_s
        self._pending: list[tuple[str, bytes]] = []
        self._peers = _PeerParameters(self)

    def parameter_client(self, name: str) -> AsyncParameterClient:
        """Return the client of a node's parameters; one for all runs, rclpy cannot give it back."""
        if name not in self._parameter_clients:
            self._parameter_clients[name] = AsyncParameterClient(self, name)
        return self._parameter_clients[name]

    def poll(self) -> bool:
        """Write what has arrived."""
        progress = False
        for stream, reader in self.readers.items():
            for _ in range(_AT_ONCE):
                if reader.take_array() is None:
                    break
                self._pending.append((stream, reader.raw))
                progress = True
        if self._bag is None and not self._open():
            return progress
        assert self._bag is not None
        try:
            self._write_pending(self._bag)
        except BagError as error:
            raise StreamFault(str(error)) from None
        if not progress and all(reader.ended for reader in self.readers.values()):
            self.finish()
        return progress

    def _write_pending(self, bag: BagWriter) -> None:
        for stream, raw in self._pending:
            bag.write(stream, raw)
        self._pending.clear()

    def watch(self, now_s: float) -> None:
        """Hand what was recorded to the operating system now and then."""
        if self._bag is not None and now_s >= self._next_flush_s:
            self._next_flush_s = now_s + self._recording.flush_period_s
            try:
                self._bag.flush()
            except BagError as error:
                raise StreamFault(str(error)) from None

    def quiesce(self) -> None:
        """Take what is still on its way and close the bag."""
        if self._bag is None and not self._open(now=True):
            return
        assert self._bag is not None
        try:
            self._write_pending(self._bag)
            self._take_the_rest(self._bag)
            self._bag.close()
        except BagError as error:
            self.failed = True
            self.get_logger().error(f'cannot finish the bag: {error}')
        self._bag = None

    def _take_the_rest(self, bag: BagWriter) -> None:
        open_readers = [reader for reader in self.readers.values() if not reader.ended]
        began = quiet_since = time.monotonic()
        while (
            open_readers and time.monotonic() - quiet_since < _SETTLE_S
            and time.monotonic() - began < _SETTLE_AT_MOST_S
        ):
            for reader in list(open_readers):
                try:
                    for _ in range(_AT_ONCE):
                        if reader.take_array() is None:
                            break
                        bag.write(reader.stream, reader.raw)
                        quiet_since = time.monotonic()
                except StreamFault as fault:
                    self.get_logger().warning(str(fault))
                    open_readers.remove(reader)
                else:
                    if reader.ended:
                        open_readers.remove(reader)
            time.sleep(0.001)

    def _open(self, now: bool = False) -> bool:
        """Open the bag once the parameters are there, or do not come."""
        waited_s = time.monotonic() - self._started_s
        if not (now or self._peers.complete() or waited_s > self._recording.parameters_timeout_s):
            return False
        parameters = self._peers.parameters
        for name in self._peers.silent:
            self.get_logger().warning(f'{name} did not tell its parameters; the bag lacks them')
        try:
            self._bag = BagWriter(
                self._directory,
                topics={stream: self.resolve_topic_name(stream) for stream in self.readers},
                metadata=run_metadata(parameters), compression=self._recording.compression)
            self._bag.attach_parameters(parameters_yaml(self.get_namespace(), parameters))
        except (BagError, ValueError) as error:
            if self.running:
                raise StreamFault(str(error)) from None
            self.get_logger().error(str(error))
            return False
        return True

    def status_fields(self) -> dict[str, Any]:
        """Return how much was recorded."""
        return {'index': max((reader.received for reader in self.readers.values()), default=0)}


class _PeerParameters:
    """Collects the parameters of the nodes that write the streams, by their services."""

    def __init__(self, recorder: Recorder) -> None:
        self.parameters: dict[str, dict[str, Any]] = {}
        self._recorder = recorder
        self._clients: dict[str, AsyncParameterClient] = {}
        self._asked_s: dict[str, float] = {}

    @property
    def silent(self) -> list[str]:
        """What has not answered yet."""
        silent = [name for name in self._clients if _base_name(name) not in self.parameters]
        return silent or ([] if self._clients else ['every writer'])

    def complete(self) -> bool:
        """Ask whom has not been asked yet; return whether every node has answered."""
        everyone_known = True
        for reader in self._recorder.readers.values():
            topic = reader.subscription.topic_name
            endpoints = self._recorder.get_publishers_info_by_topic(topic)
            # A matched writer may not be in the graph yet.
            everyone_known = everyone_known and bool(endpoints)
            for endpoint in endpoints:
                # Discovery tells of an endpoint before it tells of its node.
                if endpoint.node_name.startswith('_'):
                    everyone_known = False
                    continue
                name = f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
                if name not in self._clients:
                    self._clients[name] = self._recorder.parameter_client(name)
        now_s = time.monotonic()
        for name in self.silent if self._clients else ():
            client = self._clients[name]
            # A server that has not discovered its client throws the answer away: ask again.
            due_s = self._asked_s.get(name, -math.inf) + _ASK_AGAIN_S
            if now_s >= due_s and client.services_are_ready():
                self._asked_s[name] = now_s
                client.list_parameters(callback=partial(self._got_names, name))
        return everyone_known and not self.silent

    def _got_names(self, name: str, answer: Any) -> None:
        names = list(answer.result().result.names)
        self._clients[name].get_parameters(
            names, callback=partial(self._got_values, name, names))

    def _got_values(self, name: str, names: list[str], answer: Any) -> None:
        self.parameters[_base_name(name)] = {
            parameter_name: plain(parameter_value_to_python(value))
            for parameter_name, value in zip(names, answer.result().values, strict=True)}


def _base_name(name: str) -> str:
    return name.rpartition('/')[2]
