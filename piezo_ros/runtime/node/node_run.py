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

"""The run of a node: its begin, what is looked after while it goes on, and its end."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.observation import Monitor
from piezo_ros.runtime.node.rclpy_node.guard import explain
from piezo_ros.runtime.node.status import Status
from piezo_ros.runtime.streams.fault import SendGivenUpError, StreamFault

__all__ = ['Run']

_CHECK_PEERS_S = 0.25


class Run:
    """
    The runs of a node, one after the other.

    The stream loop calls it; `RunRequests` is for other threads.

    Parameters
    ----------
    node : NodeHooks
        The node that runs; its `run_state` is kept here.
    status, monitor
        What shows it.

    """

    def __init__(self, node: NodeHooks, status: Status, monitor: Monitor) -> None:
        self._node = node
        self._state = node.run_state
        self._status = status
        self._monitor = monitor
        self._next_check_s = 0.0

    @contextmanager
    def beginning(self) -> Iterator[None]:
        """Begin a run around what sets the node to its initial state, unless that fails."""
        self._prepare()
        try:
            yield
        except BaseException:
            for reader in self._node.readers.values():
                reader.is_open = False  # What has come is of the next run.
            raise
        self._monitor.start()
        self._node.running = True
        self._status.report('active')
        self._node.get_logger().info(f'run {self._state.number} begins')

    def _prepare(self) -> None:
        """Set the streams to the begin of a run, and forget how the last one ended."""
        node, state = self._node, self._state
        start_index, period_s = node.settings.start_index, node.settings.sample_period_s
        for reader in node.readers.values():
            reader.start(start_index, period_s)
        for writer in node.writers.values():
            writer.start(max(start_index, 0), period_s)
        state.is_over, state.reason, state.result, state.by_peer = False, '', '', False
        state.number += 1
        node.quick = node.look

    def housekeeping(self, now_s: float) -> None:
        """
        Look after peers, time limits and status; called a few times a second.

        What it raises ends the run, see `break_off`.
        """
        node = self._node
        if not node.running:
            if self._state.is_over and node.is_configured:
                for reader in node.readers.values():
                    reader.discard_rest()
            return
        for writer in node.writers.values():
            writer.flush()
        node.watch(now_s)
        if now_s >= self._next_check_s:
            self._next_check_s = now_s + _CHECK_PEERS_S
            self._check_writers()
        self._status.report_if_due(now_s)

    def _check_writers(self) -> None:
        node = self._node
        required = node.required_inputs()
        for stream, reader in node.readers.items():
            if stream in required and not reader.check_writer(node.settings.lost_writer_timeout_s):
                if not node.has_waiting(reader):
                    raise StreamFault(
                        f'{reader.subscription.topic_name} lost its writer after sample '
                        f'{reader.next_index - 1}')

    def break_off(self, error: BaseException) -> None:
        """End the run for whatever was raised while it was served or looked after."""
        if isinstance(error, SendGivenUpError):
            # What has asked the node to stop ends the run. No sample goes out until then: its
            # reader would take it for the one that was not sent.
            self._node.get_logger().warning(str(error))
            self._node.quick = _answer_nothing
        elif isinstance(error, StreamFault):
            self.fail(str(error))
        else:
            self._node.get_logger().error(''.join(traceback.format_exception(error)))
            self.fail(f'{type(error).__name__}: {error}')

    def finish(self) -> None:
        """End the run well: come to rest, pass the end on, report."""
        self._close('finished', '')

    def fail(self, reason: str) -> None:
        """End the run for a fault: come to rest, pass the end on, report why."""
        if self._node.running:
            self._state.has_failed, self._state.fault = True, reason
            self._node.get_logger().error(f'run ended: {reason}')
            self._close('faulted', reason)

    def note_fault(self, reason: str) -> None:
        """Take note of what went wrong at the end of a run; the first such reason stays."""
        self._state.has_failed, self._state.fault = True, self._state.fault or reason
        self._node.get_logger().error(reason)

    def stop(self, reason: str, *, by_peer: bool = False) -> None:
        """
        End the run because it is to end, not for a fault.

        Parameters
        ----------
        reason : str
            What wants it to end.
        by_peer : bool, optional
            Whether a peer has ended its own run, well or not: it says why.

        """
        node = self._node
        node.stop_requested = True
        if node.running:
            self._state.by_peer = by_peer
            self._close('stopped', reason)
        node.stop_requested = False

    def _close(self, result: str, reason: str) -> None:
        node, state = self._node, self._state
        node.running = False
        state.is_over, state.reason, state.result = True, reason, result
        # To rest first: a writer may wait for its reader, for as long as that does not take.
        for come_to_end in (node.quiesce, *(writer.end for writer in node.writers.values())):
            try:
                come_to_end()
            except SendGivenUpError as error:
                node.get_logger().warning(str(error))
            except Exception as error:  # What follows, and the report, must go out all the same.
                self.note_fault(explain(error))
                node.get_logger().error(traceback.format_exc())
        state.reason = state.reason or state.fault
        self._monitor.rest()
        if not state.has_failed:
            why = f' ({state.reason})' if state.reason else ''
            node.get_logger().info(
                f'run {state.number} {state.result}{why}: {node.counts()["samples"]} samples')
        self._status.report(result)


def _answer_nothing(_times: int) -> bool:
    """Stand in for `NodeHooks.look` until the run is ended."""
    return False
