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

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rclpy.parameter_client import AsyncParameterClient

from piezo_ros.nodes.learner_parts.hand_over import HandOver
from piezo_ros.nodes.learner_parts.learning_protocol import Learning, MakeLearning
from piezo_ros.nodes.learner_parts.paired_samples import PairedSamples
from piezo_ros.nodes.learner_parts.scan_peers import ScanPeers
from piezo_ros.nodes.recorder_parts.bag_directories import BagDirectories
from piezo_ros.parameters.errors import failure_text
from piezo_ros.parameters.node_parameters import LearnerParameters
from piezo_ros.runtime.node.declared_parameters import read
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_copy import copy_topic

__all__ = ['Learner']

_AT_ONCE = 64  # blocks of one stream before the next one's turn

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
        self._paired = PairedSamples()
        self._hand_over = HandOver(self._peers, self.get_logger().info)
        self._pool = ThreadPoolExecutor(1)
        self._improving: Future[None] | None = None

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
                    self._paired.add(
                        self.inputs.index(stream), reader.next_index - samples.size, samples)
        learning = self._learning or self._begin_learning()
        if learning is not None:
            try:
                for pair in self._paired.take():
                    learning.take(*pair)
                self._improve(learning)
                self._hand_over_table(learning)
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

    def _hand_over_table(self, learning: Learning) -> None:
        """Let the trajectory play the table that shall follow, if there is one."""
        if self._improving is None and learning.wanted_file:
            reference = self.readers['reference']
            if self._hand_over.advance(
                    learning, reference.next_index, has_ended=reference.ended):
                self.status.report()

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
