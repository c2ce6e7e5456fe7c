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

"""The status of a node: its state, its run and its progress as JSON on the topic ``status``."""

import json
import time
import traceback
from collections.abc import Callable

from std_msgs.msg import String

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.streams.qos import LATCHED

__all__ = ['Status']

_REPORT_S = 1.0
_LOOK_S = 0.01


class Status:
    """
    Publishes the status of a node, at every change and once a second during a run.

    Parameters
    ----------
    node : NodeHooks
        The node to report on.

    Attributes
    ----------
    publisher : Publisher
        The publisher of rclpy.

    """

    def __init__(self, node: NodeHooks) -> None:
        self._node = node
        self.publisher = node.create_publisher(String, 'status', LATCHED)
        self._next_s = 0.0

    def report(self, activity: str = '') -> None:
        """Publish the status, with another activity than before if one is given."""
        node, state = self._node, self._node.run_state
        state.activity = activity or state.activity
        self._next_s = time.monotonic() + _REPORT_S
        fields = {
            'node': node.get_name(),
            'role': node.role,
            'state': state.activity,
            'run': state.number,
            'index': max((writer.sent for writer in node.writers.values()), default=0),
            'total': None,
            'progress': None,
            'result': state.result,
            'by_peer': state.by_peer,
            'refused': sum(reader.refused for reader in node.readers.values()),
            'reason': state.reason,
            'voltage_v': None,
            **node.status_fields(),
        }
        if fields['total']:
            fields['progress'] = fields['index'] / fields['total']
        self.publisher.publish(String(data=json.dumps(fields)))

    def report_refusal(self, transition: str, why: Exception | str) -> None:
        """Say why a transition fails, in log and status; a latched fault stays the reason there."""
        node, state = self._node, self._node.run_state
        state.reason = state.fault or str(why)
        node.get_logger().error(f'cannot {transition}: {why}')
        if isinstance(why, Exception) and not isinstance(why, (ValueError, OSError)):
            node.get_logger().error(''.join(traceback.format_exception(why)))
        self.report()

    def report_if_due(self, now_s: float) -> None:
        """Publish the status if the last one is a second old."""
        if now_s >= self._next_s:
            self.report()

    def await_reader(self, has_time: Callable[[], bool]) -> None:
        """Wait until a reader of the status has been discovered."""
        while not self.publisher.get_subscription_count() and has_time():
            time.sleep(_LOOK_S)
