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

"""What a node of the loop defines for itself, and what is known of its run."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from typing import Any

from piezo_ros.parameters.node_parameters import LoopNodeParameters
from piezo_ros.runtime.node.rclpy_node.stream_node import StreamNode
from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = ['NodeHooks', 'RunState']


@dataclasses.dataclass
class RunState:
    """
    The present or newest run of a node.

    Attributes
    ----------
    number : int
        Count of runs so far.
    activity : str
        State of the lifecycle, or how the run ended.
    result : str
        How the newest run ended: finished, stopped or faulted; '' until it has.
    reason : str
        Why it ended so, or why a transition failed.
    by_peer : bool
        Whether the newest run ended because that of a peer had.
    is_over : bool
        Whether a run has ended, well or not.
    has_failed : bool
        Whether a fault is latched.
    fault : str
        The latched fault.

    """

    number: int = 0
    activity: str = 'unconfigured'
    result: str = ''
    reason: str = ''
    by_peer: bool = False
    is_over: bool = False
    has_failed: bool = False
    fault: str = ''


class NodeHooks(StreamNode):
    """
    A node with block streams, as those see it that configure, start, serve and watch it.

    A node of the loop overrides what it needs of the methods here; `poll` it must.

    Parameters
    ----------
    role : str
        Role, and name of the node unless it is given another.

    """

    program = ''  # one of `PROGRAM_PARAMETERS`, where the parameters are not those of the role
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    urgent = True  # whether peers wait for its next message: it looks for its input all the time
    # Whether a node that is not urgent had better let its input pile up.
    in_bursts = False
    # Whether it subscribes only once it knows the writers, which wait for their readers: in a loop
    # each node waits for the next, none for a recorder.
    subscribes_late = False
    # The diagnostics warn where these counts grow.
    troubles: tuple[str, ...] = ('refused_messages', 'gaps')

    settings: LoopNodeParameters  # there once the node is configured

    def __init__(self, role: str) -> None:
        super().__init__(role)
        self.role = role
        self.readers: dict[str, StreamReader] = {}
        self.writers: dict[str, StreamWriter] = {}
        self.run_state = RunState()
        self.running = False
        self.in_blocks = False  # several samples come in and go out at a time
        self.is_configured = False
        self.is_activating = False
        self.given_up = False  # the activation is no longer wanted
        self.stop_requested = False
        # What the stream loop calls: `look`, or a quicker way that does the same.
        self.quick: Callable[[int], bool] = self.look

    def configure(self) -> None:
        """Make constants of the parameters."""

    def create_readers(self) -> None:
        """Subscribe to the inputs."""
        self.readers = {
            stream: StreamReader(self, stream, self.input_topic(stream)) for stream in self.inputs}

    def create_streams(self) -> None:
        """Subscribe to the inputs, unless that comes late, and create the outputs."""
        if not self.subscribes_late:
            self.create_readers()
        self.writers = {
            stream: StreamWriter(self, stream, self.settings.recorded_block_samples)
            for stream in self.outputs}

    def destroy_streams(self) -> None:
        """Destroy what takes the inputs and publishes the outputs."""
        for reader in self.readers.values():
            self.destroy_hidden_subscription(reader.subscription)
        for writer in self.writers.values():
            for publisher in writer.publishers:
                self.destroy_publisher(publisher)
        self.readers, self.writers = {}, {}

    def create_endpoints(self) -> None:
        """Create what the node has beside its streams."""

    def input_topic(self, stream: str) -> str:
        """Return the topic of an input."""
        return stream

    def required_inputs(self) -> tuple[str, ...]:
        """Return the inputs that must have a writer before the run starts."""
        return self.inputs

    def missing_peers(self) -> str:
        """Return what else is missing before the run can start, '' for nothing."""
        return ''

    def start(self) -> None:
        """Set all state to its initial value; the peers are there."""

    def begin_at(self, index: int) -> None:
        """Give the outputs the index that an input has begun at (``start_index`` -1)."""
        for writer in self.writers.values():
            writer.begin_at(index)

    def poll(self) -> bool:
        """Do what can be done now; return whether there was anything."""
        raise NotImplementedError

    def look(self, times: int) -> bool:
        """Poll until there is something, but only so often, yielding in between; return as that."""
        while not self.poll():
            times -= 1
            if times <= 0 or self.stop_requested or not self.running:
                return False
            os.sched_yield()
        return True

    def watch(self, now_s: float) -> None:
        """Look after time limits; called a few times a second while running."""

    def has_waiting(self, reader: StreamReader) -> bool:
        """Return whether samples of an input wait, so that its writer may be gone by now."""
        return False

    def quiesce(self) -> None:
        """Bring whatever the node drives to rest; called once at the end of a run."""

    def status_fields(self) -> dict[str, Any]:
        """Return what the node adds to its status."""
        return {}

    def counts(self) -> dict[str, int]:
        """Return what the diagnostics tell of the run: samples, and what went wrong how often."""
        readers = self.readers.values()
        return {
            'samples': max(
                (end.sent for end in self.writers.values()),
                default=max((end.received for end in readers), default=0)),
            'refused_messages': sum(reader.refused for reader in readers),
            'gaps': sum(reader.gaps for reader in readers),
            'lag_samples': max((len(reader.queue) for reader in readers), default=0),
        }

    def change_parameters(self, changes: Mapping[str, Any]) -> str:
        """Take changes that the sets allow, in the executor; return why not, '' if so."""
        return ''

    def parameters_changed(self) -> None:
        """Take over what may change at once; the new values are there."""
