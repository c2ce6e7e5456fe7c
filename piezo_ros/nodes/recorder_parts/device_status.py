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

"""What the status of a hardware plant tells of its device, for the bag."""

import json
import time
from typing import Any, Final

from std_msgs.msg import String

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.qos import EVERY_STATUS

__all__ = ['DeviceStatus']

# Field of the status -> entry of the metadata.
_ENTRIES: Final = {
    'device': 'device', 'device_rate_hz': 'device_rate_hz',
    'voltage_before_v': 'device_voltage_before_v', 'voltage_after_v': 'device_voltage_after_v',
    'played': 'device_played', 'overruns': 'device_overruns', 'jitter_rms_s': 'device_jitter_rms_s',
    'jitter_max_s': 'device_jitter_max_s'}
_OVER: Final = ('finished', 'faulted', 'stopped')
_REST_S: Final = 5.0  # for the ramp of a run that is cut short
_LOOK_S: Final = 0.01


class DeviceStatus:
    """
    Follows the status of the plant, where it is one with a device.

    Parameters
    ----------
    recorder : LoopNode
        The node that looks.

    """

    def __init__(self, recorder: LoopNode) -> None:
        subscription = recorder.create_own_subscription(String, 'status', EVERY_STATUS)
        self._take_message = subscription.handle.take_message
        self._newest: dict[str, Any] = {}

    def _take(self) -> None:
        while (taken := self._take_message(String, False)) is not None:
            try:
                status = json.loads(taken[0].data)
            except (ValueError, RecursionError):
                continue
            if isinstance(status, dict) and status.get('role') == 'plant' and 'device' in status:
                self._newest = status

    def metadata(self) -> dict[str, str]:
        """Return what is known of the device; nothing without one."""
        self._take()
        return {
            entry: str(self._newest[field]) for field, entry in _ENTRIES.items()
            if self._newest.get(field) not in (None, '')}

    def await_rest(self) -> None:
        """Wait until the output of a device is at rest, which is told a little after the end."""
        waited = RunningTime()
        while self._is_driven() and waited.elapsed_s() < _REST_S:
            time.sleep(_LOOK_S)

    def _is_driven(self) -> bool:
        self._take()
        return bool(
            self._newest and self._newest.get('voltage_after_v') is None
            and self._newest.get('state') not in _OVER)
