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
import threading

import pytest

from piezo_ros.cli.identify import identify_hysteresis
from piezo_ros.cli.main import main
from piezo_ros.cli.shared import progress as progress_module
from piezo_ros.cli.shared.progress import Progress, working
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.identification.hysteresis import hysteresis_fit
from piezo_ros.identification.tuning import pi_tuning

PATIENCE_S = 30.0
SLOW_TRIANGLE = """
format_version: 1
title: A triangle
runs: [{waveform: decreasing_triangle, output: voltage, amplitude_v: 3.0, frequency_hz: 100,
        periods: 5}]
score_periods: 1
"""


class Terminal(io.StringIO):
    def __init__(self):
        super().__init__()
        self.wrote = threading.Event()

    def isatty(self):
        return True

    def write(self, text):
        count = super().write(text)
        self.wrote.set()
        return count


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


def on_terminal(monkeypatch):
    """Write to a terminal, at once; not in a fixture, pytest captures the stages apart."""
    monkeypatch.setattr(progress_module, '_PATIENCE_S', 0.0)
    monkeypatch.setattr(sys, 'stderr', Terminal())
    return sys.stderr


def test_long_work_is_told_on_a_terminal_alone(monkeypatch):
    terminal = on_terminal(monkeypatch)
    with working('fitting'), working('a part of it'):
        assert terminal.wrote.wait(PATIENCE_S)
    assert terminal.getvalue().startswith('\rfitting  0 s')
    assert terminal.getvalue().endswith(' s\n')
    assert 'part' not in terminal.getvalue()
    with pytest.raises(ZeroDivisionError), working('again'):
        1 / 0  # noqa: B018
    monkeypatch.setattr(sys, 'stderr', io.StringIO())
    threads = threading.active_count()
    with working('fitting'):
        assert threading.active_count() == threads
    assert sys.stderr.getvalue() == ''


def test_what_takes_no_longer_than_a_moment_is_not_told(monkeypatch):
    terminal = on_terminal(monkeypatch)
    monkeypatch.setattr(progress_module, '_PATIENCE_S', PATIENCE_S)
    with working('fitting'):
        pass
    assert terminal.getvalue() == ''


def when_told(terminal, function):
    """Return a function that waits until the terminal has a word."""
    def waiting(*arguments, **options):
        terminal.wrote.clear()
        assert terminal.wrote.wait(PATIENCE_S)
        return function(*arguments, **options)
    return waiting


def test_identify_and_tune_tell_what_they_do(monkeypatch, tmp_path, models):
    (tmp_path / 'triangle.yaml').write_text(SLOW_TRIANGLE)
    simulate_run(read_plan(tmp_path / 'triangle.yaml').runs[0], tmp_path / 'bag')
    terminal = on_terminal(monkeypatch)
    for module, name in (
            (identify_hysteresis, 'reduced_run'), (hysteresis_fit, 'fit_hysteresis_records'),
            (pi_tuning, 'tune_pi')):
        monkeypatch.setattr(module, name, when_told(terminal, getattr(module, name)))
    main(['identify', 'hysteresis', 'bag', '--elements', '4', '--every', '20', '--accept-poor',
          '-o', 'found.yaml'])
    assert main(['tune', 'trajectory.yaml', '--no-operating-points', '-o', 'tuned.yaml']) == 0
    for text in 'reading bag', 'fitting the hysteresis', 'tuning the gains':
        assert f'\r{text}  ' in terminal.getvalue()
