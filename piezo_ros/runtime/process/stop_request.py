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

"""The signals that ask a process to end, remembered until its loop looks."""

import signal
from types import FrameType

from piezo_ros.interruption import leave_closed_terminal, set_stop_handler

__all__ = ['StopRequest']


class StopRequest:
    """
    Handler of the stop signals that remembers which of them came last.

    Attributes
    ----------
    signal_number : int
        The signal, 0 until one has come.
    is_last_call : bool
        Whether SIGTERM or SIGHUP has come after another signal: SIGKILL is next.

    """

    def __init__(self) -> None:
        self.signal_number = 0
        self.is_last_call = False

    def listen(self) -> None:
        """Take SIGINT, SIGTERM and SIGHUP from now on."""
        set_stop_handler(self)

    def __call__(self, signal_number: int, _frame: FrameType | None) -> None:
        """Remember a signal."""
        # SIGINT may come at any time: from the terminal, and from what started the process.
        if signal_number != signal.SIGINT and self.signal_number not in (0, signal_number):
            self.is_last_call = True
        self.signal_number = signal_number
        leave_closed_terminal()
