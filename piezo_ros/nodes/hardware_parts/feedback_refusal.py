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

"""Refuses a controller with feedback where the clock of a device plays the run."""

import json

from std_msgs.msg import String

from piezo_ros.control.controller_step import SCHEMES, ControllerParameters
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.streams.qos import EVERY_STATUS

__all__ = ['FeedbackRefusal']


class FeedbackRefusal:
    """
    Follows the status of the controller, which tells its scheme.

    Parameters
    ----------
    node : LoopNode
        The plant.

    """

    def __init__(self, node: LoopNode) -> None:
        subscription = node.create_own_subscription(String, 'status', EVERY_STATUS)
        self._take_message = subscription.handle.take_message
        self._scheme = ''

    def reason(self) -> str:
        """Return why the present scheme is refused, '' where it is not, or not known."""
        while (taken := self._take_message(String, False)) is not None:
            self._note(taken[0].data)
        if not self._scheme:
            return ''
        return (
            f'the controller has the scheme {self._scheme}, which needs each reading before the '
            'next voltage; timing is hardware, where the device plays voltages that are there '
            'already. Take the scheme ff or open_loop, or timing on_demand up to 1 kHz')

    def _note(self, text: str) -> None:
        try:
            status = json.loads(text)
        except (ValueError, RecursionError):
            return
        if isinstance(status, dict) and status.get('role') == 'controller':
            scheme = str(status.get('scheme'))
            needs = scheme in SCHEMES and ControllerParameters(scheme=scheme).uses_feedback
            self._scheme = scheme if needs else ''
