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

import sys
from typing import Protocol

__all__ = ['Progress', 'ShownProgress']

_WIDTH = 30


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
