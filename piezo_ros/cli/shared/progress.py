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

"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from typing import Final, Protocol

__all__ = ['Progress', 'ShownProgress', 'working']

_WIDTH = 30
_PATIENCE_S: Final = 2.0  # what takes no longer needs no word
_REFRESH_S: Final = 1.0
_LINE: Final = threading.Lock()  # of what is done within something else nothing is shown


class Progress:
    """Shows what is being done and how far it is, on standard error."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._text = ''
        self._open = False

    def announce(self, text: str) -> None:
        """Show what begins now."""
        self.end()
        self._text = text
        if self._terminal:
            self.show(0.0)
        else:
            print(text, file=sys.stderr, flush=True)

    def show(self, share: float) -> None:
        """Show how much of it is done, 0 … 1; nothing where there is no terminal."""
        if self._terminal:
            filled = round(share * _WIDTH)
            bar = '█' * filled + '·' * (_WIDTH - filled)
            print(f'\r{self._text}  {bar} {share:4.0%}', end='', file=sys.stderr, flush=True)
            self._open = True

    def end(self) -> None:
        """Leave the line of the bar."""
        if self._open:
            print(file=sys.stderr)
            self._open = False


class _View(Protocol):
    def announce(self, text: str) -> None:
        ...

    def show(self, share: float) -> None:
        ...


class ShownProgress(Progress):
    """
    Shows progress on standard error and in a view.

    Parameters
    ----------
    view : LiveView
        The view.

    """

    def __init__(self, view: _View) -> None:
        super().__init__()
        self._view = view

    def announce(self, text: str) -> None:
        """Show what begins now."""
        super().announce(text)
        self._view.announce(text)

    def show(self, share: float) -> None:
        """Show how much of it is done, 0 … 1."""
        super().show(share)
        self._view.show(share)


@contextlib.contextmanager
def working(text: str) -> Iterator[None]:
    """
    Show on a terminal what is being done and for how long, where nothing tells how far it is.

    The line appears after some seconds, and nowhere but on a terminal. What is done meanwhile must
    not print anything.

    Parameters
    ----------
    text : str
        What is being done.

    """
    if not (sys.stderr.isatty() and _LINE.acquire(blocking=False)):
        yield
        return
    terminal, start_s, over = sys.stderr, time.monotonic(), threading.Event()
    is_shown = False

    def show() -> None:
        nonlocal is_shown
        wait_s = _PATIENCE_S
        with contextlib.suppress(OSError, ValueError):  # the terminal may be gone
            while not over.wait(wait_s):
                is_shown, wait_s = True, _REFRESH_S
                print(
                    f'\r{text}  {time.monotonic() - start_s:.0f} s', end='', file=terminal,
                    flush=True)

    thread = threading.Thread(target=show, name='progress', daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        _LINE.release()
        if is_shown:
            print(file=terminal)
