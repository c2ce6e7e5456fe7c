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

"""
Stop signals that cannot get lost: Ctrl-C, and a terminal that is closed.

Python raises KeyboardInterrupt wherever the process happens to be. While modules are imported that
may be code that catches everything, and the command would go on as if nothing had happened.
"""

import errno
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final, TypeGuard

try:
    import termios
except ImportError:  # on Windows, where the commands without ROS run too
    termios = None  # type: ignore[assignment]

__all__ = [
    'STOP_SIGNALS',
    'HeldInterruption',
    'Interruption',
    'holding_interruption',
    'interruptible',
    'leave_closed_terminal',
    'remembering_interruption',
    'set_stop_handler',
    'stopped_by',
    'was_interrupted',
]

# What asks a process to end: Ctrl-C, a manager of processes, a terminal that is closed.
# Windows has no such terminals.
_HANG_UP: Final = (signal.SIGHUP,) if hasattr(signal, 'SIGHUP') else ()
STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, *_HANG_UP)
_TERMINAL_FILES: Final = (0, 1, 2)


class _StopSignalCame(KeyboardInterrupt):
    """
    A KeyboardInterrupt that leaves the exit code to the command.

    Where one of Python's own class passes code that C has started, such as that of an extension
    module, ``python -m`` ends by SIGINT after whatever exit code the command has returned.
    """


class Interruption:
    """
    Handler of stop signals that raises KeyboardInterrupt, and remembers the signal.

    Attributes
    ----------
    signal_number : int
        The signal that has come last, 0 for none.

    """

    def __init__(self) -> None:
        self.signal_number = 0

    @property
    def came(self) -> bool:
        """Whether a signal has come."""
        return bool(self.signal_number)

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        """Remember the signal and raise KeyboardInterrupt with its name."""
        self.signal_number = number
        leave_closed_terminal()
        self.raise_what_came()

    def raise_what_came(self) -> None:
        """Raise KeyboardInterrupt with the name of the signal, if one has come."""
        if self.came:
            raise _StopSignalCame(signal.Signals(self.signal_number).name)


class HeldInterruption(Interruption):
    """Handler that raises once at most, and within `released` only; it remembers elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self._may_raise = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Remember the signal, and raise KeyboardInterrupt where that may be."""
        self.signal_number = number
        leave_closed_terminal()
        if self._may_raise:
            self._may_raise = False  # What follows the first is not to be cut off by a second.
            self.raise_what_came()

    @contextmanager
    def released(self) -> Iterator[None]:
        """Let a signal raise in here, also one that has come before."""
        try:
            self._may_raise = not self.came
            self.raise_what_came()
            yield
        finally:
            self._may_raise = False


@contextmanager
def remembering_interruption() -> Iterator[Interruption]:
    """
    Have an `Interruption` in place of the default handlers of SIGINT and SIGHUP.

    Another handler stays: a shell may have told the process to ignore the signal. So do the
    defaults outside of the main thread, where no handler can be set.
    """
    interruption = Interruption()
    defaults = {
        signal.SIGINT: signal.default_int_handler, **dict.fromkeys(_HANG_UP, signal.SIG_DFL)}
    replaced = {}
    if threading.current_thread() is threading.main_thread():
        replaced = {
            number: default for number, default in defaults.items()
            if signal.getsignal(number) is default}
    for number in replaced:
        signal.signal(number, interruption)
    try:
        yield interruption
    finally:
        for number, default in replaced.items():
            signal.signal(number, default)


@contextmanager
def interruptible() -> Iterator[None]:
    """
    Let stop signals raise KeyboardInterrupt, also where a handler would only remember them.

    For what no run depends on, such as the report after the last run.
    """
    with _in_place_of(callable, Interruption()):
        yield


@contextmanager
def holding_interruption() -> Iterator[HeldInterruption]:
    """
    Have stop signals wait for the parts that they may end, or for the end of the whole.

    For what leaves something driven if it is cut off. A signal that is ignored stays so.
    """
    interruption = HeldInterruption()
    with _in_place_of(lambda before: before not in (None, signal.SIG_IGN), interruption):
        yield interruption
    interruption.raise_what_came()


@contextmanager
def _in_place_of(is_replaced: Callable[[Any], bool], interruption: Interruption) -> Iterator[None]:
    """Put an interruption in place of some handlers of stop signals, in the main thread only."""
    replaced = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        replaced = {number: before for number, before in handlers.items() if is_replaced(before)}
    for number in replaced:
        signal.signal(number, interruption)
    try:
        yield
    finally:
        for number, before in replaced.items():
            signal.signal(number, before)


def set_stop_handler(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    """Set the handler of all stop signals; SIGHUP stays ignored where nohup has ignored it."""
    for number in STOP_SIGNALS:
        if number not in _HANG_UP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def was_interrupted(handler: object) -> TypeGuard[Interruption]:
    """Return whether a handler is an `Interruption` that has received a signal."""
    return isinstance(handler, Interruption) and handler.came


def stopped_by(interrupt: KeyboardInterrupt) -> str:
    """Return what to say of a command that a stop signal has ended."""
    return f'stopped by {interrupt}' if interrupt.args else 'stopped by SIGINT'


def leave_closed_terminal() -> None:
    """Write nowhere in place of a terminal that is gone, where every write would fail."""
    if termios is None:
        return
    for number in _TERMINAL_FILES:
        try:
            termios.tcgetattr(number)
        except termios.error as error:
            if error.args[0] == errno.EIO:
                with open(os.devnull, 'r+b', buffering=0) as nowhere:
                    os.dup2(nowhere.fileno(), number)
