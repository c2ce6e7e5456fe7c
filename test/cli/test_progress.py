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

import io
import sys

import pytest

from piezo_ros.cli.shared.progress import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def show(monkeypatch):
    def on(stream):
        monkeypatch.setattr(sys, 'stderr', stream)
        progress = Progress()
        progress.announce('one')
        progress.show(0.5)
        progress.announce('two')
        progress.show(1.0)
        progress.end()
        progress.end()
        return stream.getvalue()
    return on


def test_elsewhere_than_on_a_terminal_there_are_plain_lines(show):
    assert show(io.StringIO()) == 'one\ntwo\n'


def test_on_a_terminal_a_bar_fills_and_its_line_is_left_once(show):
    text = show(Terminal())
    assert text.count('\n') == 2
    bars = text.replace('\n', '').split('\r')[1:]
    assert [bar[:3] for bar in bars] == ['one', 'one', 'two', 'two']
    assert [bar.count('█') for bar in bars] == [0, 15, 0, 30]
    assert [bar[-4:] for bar in bars] == ['  0%', ' 50%', '  0%', '100%']
