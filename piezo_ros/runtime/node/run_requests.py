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

"""What services and transitions, which are in other threads, ask of the run of a node."""

from collections.abc import Callable, Iterable

from rclpy.publisher import Publisher

from piezo_ros.runtime.node.handshake import await_acknowledgements
from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.node_run import Run
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError
from piezo_ros.runtime.node.status import Status
from piezo_ros.runtime.process.running_time import RunningTime

__all__ = ['RunRequests']

_FAREWELL_S = 2.0  # how long the readers of an interrupted run have for its end


class RunRequests:
    """
    Has the stream loop do what others want of the runs of a node.

    Parameters
    ----------
    node : NodeHooks
        The node.
    run : Run
        Its runs.
    status : Status
        What shows them.

    """

    def __init__(self, node: NodeHooks, run: Run, status: Status) -> None:
        self._node = node
        self._run = run
        self._status = status

    def end(self, reason: str) -> None:
        """End the run, also where a writer waits for its reader."""
        self._node.stop_requested = True  # First, so that the writer gives up.
        self._node.between_samples(lambda: self._run.stop(reason))

    def end_for_readers(self, reason: str, publishers: Iterable[Publisher]) -> None:
        """End the run; a reader that begins one after this finds the end among what has come."""
        self.end(reason)
        waited = RunningTime()
        await_acknowledgements(publishers, lambda: waited.elapsed_s() < _FAREWELL_S)

    def during_run(self, action: Callable[[], None]) -> None:
        """
        Do what changes a run, between two of its samples.

        Raises
        ------
        ServiceRefusedError
            If the next sample does not come, since a reader does not take the one before.

        """
        self._node.between_samples(action, self._blocked)

    def _blocked(self) -> str:
        for writer in self._node.writers.values():
            if writer.is_waiting:
                return (
                    f'{writer.publisher.topic_name} waits for a reader that does not take its '
                    'messages; end that reader or call ~/stop')
        return ''

    def between_runs(self, action: Callable[[], None]) -> None:
        """
        Do what must not be done during a run.

        Raises
        ------
        ServiceRefusedError
            If a run goes on or is about to begin, or the node is not configured.

        """
        def checked() -> None:
            self._refuse_during_run()  # One may have begun before the stream loop came here.
            action()

        self._refuse_during_run()
        if self._node.is_activating:
            raise ServiceRefusedError('a run is about to begin; call ~/stop to give it up')
        if not self._node.is_configured:
            raise ServiceRefusedError('the node is not configured')
        self._node.between_samples(checked)

    def reset(self) -> str:
        """Clear a latched fault, so that the next activation is allowed."""
        self._refuse_during_run()
        state = self._node.run_state
        was = f'cleared: {state.fault}' if state.has_failed else 'there was no fault'
        state.has_failed, state.fault, state.reason = False, '', ''
        self._status.report()
        return was

    def stop(self) -> str:
        """End the run, or give up the activation before it."""
        node, state = self._node, self._node.run_state
        if node.is_activating and not node.running:
            node.given_up = True
            return 'the activation is given up'
        if not node.running:
            raise ServiceRefusedError('no run is going on')
        self.end('asked to by ~/stop')
        return f'{state.result}: {state.reason}' if state.reason else state.result

    def _refuse_during_run(self) -> None:
        if self._node.running:
            raise ServiceRefusedError('a run is going on; call ~/stop or deactivate first')
