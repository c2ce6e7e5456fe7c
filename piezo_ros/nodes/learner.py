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

"""The learner: a planned scan improved while it runs, by other tables for the trajectory."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.control.tables.table_changes import TableChange
from piezo_ros.nodes.learner_parts.scan_peers import ScanPeers
from piezo_ros.nodes.recorder_parts.bag_directories import BagDirectories
from piezo_ros.parameters.errors import failure_text
from piezo_ros.parameters.node_parameters import LearnerParameters
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.node.parameters import read
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_copy import copy_topic

__all__ = ['Learner', 'Learning', 'MakeLearning']

_AT_ONCE = 64  # blocks of one stream before the next one's turn
_FIRST_MARGIN = 2000  # samples between the newest reference and a change
_MOST_MARGIN = 2**22

_Floats = NDArray[np.float64]


class Learning(Protocol):
    """What the node needs of the mathematics; see `RunningLearning`."""

    wanted_file: str
    why_done: str

    @property
    def is_done(self) -> bool:
        """Whether nothing follows the table in use."""

    @property
    def is_measured(self) -> bool:
        """Whether the table in use can be improved."""

    def take(self, index: int, reference_um: _Floats, displacement_um: _Floats) -> None:
        """Take the next samples of the run."""

    def improve(self) -> None:
        """Learn from what was measured, and write the next table."""

    def change_from(self, earliest: int) -> TableChange:
        """Return the change to the table that shall follow, at a sample or soon after it."""

    def accept(self, change: TableChange) -> None:
        """Take note that the trajectory plays the table."""

    def refuse(self, reason: str) -> None:
        """Take note that the trajectory keeps its table."""

    def end(self) -> None:
        """Take note that the run has ended."""

    def status(self) -> dict[str, Any]:
        """Return what came of it so far."""


# Settings, output directory, parameters of trajectory and controller -> what learns.
MakeLearning = Callable[
    [LearnerParameters, Path, Mapping[str, Any], Mapping[str, Any]], Learning]


class Learner(LoopNode):
    """
    Measures a running scan and hands another table to the trajectory, until none pays.

    Parameters
    ----------
    make_learning : callable
        Makes what learns, once the run and its parameters are known.

    """

    urgent = False
    in_bursts = True
    subscribes_late = True
    inputs = ('reference', 'displacement')

    def __init__(self, make_learning: MakeLearning, *, compiled: bool = False) -> None:
        self._make_learning = make_learning
        self._parameter_clients: dict[str, AsyncParameterClient] = {}
        self._directories = BagDirectories('directory', 'learned')
        self._learning: Learning | None = None
        super().__init__('learner', compiled=compiled)

    def configure(self) -> None:
        """Decide where the output goes; a directory that exists is refused now, not later."""
        self._own = read(self, LearnerParameters)
        if not Path(self._own.scan).is_file():
            raise ValueError(f'scan is {self._own.scan!r}, it must be a file that piezo plan wrote')
        self._directories.next(self._own.directory)

    def input_topic(self, stream: str) -> str:
        """Return the topic of a stream, or of its copy."""
        return copy_topic(stream) if self._own.from_copies else stream

    def start(self) -> None:
        """Forget everything; ask the other nodes for their parameters."""
        self._peers = ScanPeers(self, self._client)
        self._waited = RunningTime()
        self._learning = None
        self._waiting: dict[str, list[tuple[int, _Floats]]] = {
            stream: [] for stream in self.inputs}
        self._pool = ThreadPoolExecutor(1)
        self._improving: Future[None] | None = None
        self._asked: TableChange | None = None
        self._margin = _FIRST_MARGIN

    def _client(self, name: str) -> AsyncParameterClient:
        """Return the client of a node's parameters; one for all runs, rclpy cannot give it back."""
        if name not in self._parameter_clients:
            self._parameter_clients[name] = AsyncParameterClient(self, name)
        return self._parameter_clients[name]

    def poll(self) -> bool:
        """Take what has arrived; measure, improve, hand over."""
        progress = False
        for stream, reader in self.readers.items():
            for _ in range(_AT_ONCE):
                samples = reader.take_array()
                if samples is None:
                    break
                progress = True
                if samples.size:
                    self._waiting[stream].append((reader.next_index - samples.size, samples))
        learning = self._learning or self._begin_learning()
        if learning is not None:
            try:
                self._feed(learning)
                self._improve(learning)
                self._hand_over(learning)
            except (ValueError, OSError) as error:
                raise StreamFault(failure_text(error)) from None
        if not progress and all(reader.ended for reader in self.readers.values()):
            if learning is None:
                raise StreamFault(self._silence())
            if self._improving is None:
                self.finish()
        return progress

    def _begin_learning(self) -> Learning | None:
        """Make what learns, once trajectory and controller have told their parameters."""
        if not self._peers.complete():
            if self._waited.elapsed_s() > self._own.parameters_timeout_s:
                raise StreamFault(self._silence())
            return None
        directory = self._directories.next(self._own.directory)
        told = self._peers.parameters
        try:
            self._learning = self._make_learning(
                self._own, directory, told['trajectory'], told['controller'])
        except (ValueError, OSError) as error:
            raise StreamFault(failure_text(error)) from None
        self._directories.note_written(directory)
        self.get_logger().info(f'learns into {directory}')
        return self._learning

    def _silence(self) -> str:
        return (
            f'{" and ".join(self._peers.missing)} did not tell their parameters within '
            f'{self._own.parameters_timeout_s:g} s (parameters_timeout_s)')

    def _feed(self, learning: Learning) -> None:
        """Hand over the samples that both streams have."""
        reference, displacement = (self._waiting[stream] for stream in self.inputs)
        while reference and displacement:
            first = max(reference[0][0], displacement[0][0])
            count = min(start + part.size for start, part in (
                reference[0], displacement[0])) - first
            parts = []
            for waiting in (reference, displacement):
                start, part = waiting[0]
                at = first - start
                parts.append(part[at:at + max(count, 0)])
                rest = part[at + max(count, 0):]
                if rest.size:
                    waiting[0] = (start + part.size - rest.size, rest)
                else:
                    waiting.pop(0)
            if count > 0:
                learning.take(first, *parts)

    def _improve(self, learning: Learning) -> None:
        """Let a thread improve what is measured: the streams must not wait for it."""
        if self._improving is not None:
            if not self._improving.done():
                return
            done, self._improving = self._improving, None
            done.result()
            self._tell(learning)
        elif learning.is_measured:
            self._improving = self._pool.submit(learning.improve)

    def _hand_over(self, learning: Learning) -> None:
        """Ask the trajectory to play the table that shall follow, and take its answer."""
        if self._improving is not None or not learning.wanted_file:
            return
        reference = self.readers['reference']
        if self._asked is None:
            if reference.ended:
                learning.end()
                return
            self._peers.forget_change()
            self._asked = learning.change_from(reference.next_index + self._margin)
        if self._peers.refusal is None:
            if reference.ended:
                self._asked = None
                learning.end()
            else:
                self._peers.change_file(self._asked)
            return
        change, self._asked = self._asked, None
        if not self._peers.refusal:
            learning.accept(change)
            self.get_logger().info(f'from sample {change.at_sample} on: {change.file}')
        elif 'already' in self._peers.refusal and self._margin < _MOST_MARGIN:
            self._margin *= 2  # the sample was over
        else:
            self.get_logger().warning(f'{change.file} was refused: {self._peers.refusal}')
            learning.refuse(self._peers.refusal)
        self._tell(learning)

    def _tell(self, learning: Learning) -> None:
        status = learning.status()
        if status['nrmse_percent'] is not None:
            self.get_logger().info(
                f'NRMSE {status["nrmse_percent"]:.3f} %, the best '
                f'{status["best_nrmse_percent"]:.3f} %'
                f'{"; " + learning.why_done if learning.why_done else ""}')
        self.status.report()

    def quiesce(self) -> None:
        """Wait for what is being computed."""
        self._pool.shutdown()
        if self._learning is not None:
            self._learning.end()

    def status_fields(self) -> dict[str, Any]:
        """Return what was learned so far."""
        received = max((reader.received for reader in self.readers.values()), default=0)
        return {'index': received, **(self._learning.status() if self._learning else {})}
