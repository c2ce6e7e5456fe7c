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
A Ctrl-C that cannot get lost.

Python raises KeyboardInterrupt wherever the process happens to be. While modules are imported that
may be code that catches everything, and the command would go on as if nothing had happened.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ['Interruption', 'remembering_interruption', 'was_interrupted']


class Interruption:
    """
    Handler of SIGINT that raises KeyboardInterrupt, as Python's own, and remembers it.

    Attributes
    ----------
    came : bool
        Whether the signal has come.

    """

    def __init__(self) -> None:
        self.came = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Remember the signal and raise KeyboardInterrupt."""
        self.came = True
        raise KeyboardInterrupt


@contextmanager
def remembering_interruption() -> Iterator[Interruption]:
    """
    Have an `Interruption` in place of Python's own handler of SIGINT.

    Another handler stays: a shell may have told the process to ignore the signal. So does Python's
    outside of the main thread, where no handler can be set.
    """
    interruption = Interruption()
    before = signal.getsignal(signal.SIGINT)
    replaces = before is signal.default_int_handler and (
        threading.current_thread() is threading.main_thread())
    if replaces:
        signal.signal(signal.SIGINT, interruption)
    try:
        yield interruption
    finally:
        if replaces:
            signal.signal(signal.SIGINT, before)


def was_interrupted(handler: object) -> bool:
    """Return whether a handler of SIGINT is an `Interruption` that has received the signal."""
    return isinstance(handler, Interruption) and handler.came
