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

"""The live view beside a campaign: it never ends one, and says what it cannot do."""

import signal
import socket
import time

import pytest
from live_feed import planned_runs, show_run

from piezo_ros.cli.shared.command_line import argument_parser
from piezo_ros.live.view import live_view
from piezo_ros.live.view.live_view import LiveView
from piezo_ros.live.view.watched_runs import WatchedRigs, WatchedRuns
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import RunResult


@pytest.fixture
def view():
    view = LiveView('title', 2)
    yield view
    view.close(0)


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    (run,) = planned_runs(tmp_path_factory.mktemp('plan'), {'scheme': 'ff', 'periods': 20})
    return run


def _told(view):
    return view._data({})


def test_a_mistake_of_the_view_is_told_once_and_ends_nothing(view, capsys):
    for _ in range(5):
        view.begin_run({'': None})
        view.end_run(problem='why')
    told = capsys.readouterr().err
    assert told.count('the live view does not show all') == 2  # one for each method
    assert 'Traceback' not in told


def test_a_run_is_shown_from_its_begin_to_its_end(view, planned, tmp_path):
    dropped = []

    def run(planned_run, bag):
        assert (planned_run, bag, dropped) == (planned, tmp_path, [True])
        show_run(view, planned_run, most=10, step=30)
        assert _told(view)['runs'][-1]['state'] == 'running'
        return RunResult(1.5)

    watched = WatchedRuns(view, run, lambda: dropped.append(True))
    assert watched(planned, tmp_path).wall_seconds == 1.5
    told = _told(view)
    assert told['runs'][-1] | {'description': ''} == {
        'number': 1, 'name': planned.name, 'description': '', 'state': 'done', 'detail': '1.5 s'}
    assert len(told['rigs'][0]['tracking'][0]) == 10


def test_a_run_that_fails_is_shown_as_failed_and_fails(view, planned, tmp_path):
    def run(*_):
        raise CampaignError('plant: why')

    with pytest.raises(CampaignError, match='plant: why'):
        WatchedRuns(view, run, lambda: None)(planned, tmp_path)
    assert _told(view)['runs'][-1]['detail'] == 'plant: why'


def test_both_axes_of_a_scan_are_shown(view, planned, tmp_path):
    class Rigs:
        def alone(self, run, bag):
            return RunResult(1.0)

        def together(self, runs, bags):
            for axis, run in runs.items():
                show_run(view, run, rig=axis, most=4, step=30)
            return RunResult(1.0), RunResult(2.0)

    rigs = WatchedRigs(view, Rigs(), ('x', 'y'), lambda: None)
    rigs.alone(planned, tmp_path)
    assert [rig['run'] for rig in _told(view)['rigs']] == [1, 0]
    assert len(rigs.together({'x': planned, 'y': planned}, {})) == 2
    assert [(rig['name'], rig['run'], len(rig['tracking'][0])) for rig in _told(view)['rigs']] == [
        ('x', 2, 4), ('y', 1, 4)]
    assert _told(view)['runs'][-1]['detail'] == '2.0 s'


def test_a_stop_is_the_signal_of_ctrl_c_once_and_none_after_the_end(view, monkeypatch, capsys):
    signals = []
    monkeypatch.setattr(live_view.os, 'kill', lambda *sent: signals.append(sent))
    view._stop()
    view._stop()
    assert [number for _, number in signals] == [signal.SIGINT]
    assert 'stop, by the button of the live view' in capsys.readouterr().err
    assert _told(view)['is_stopping']
    other = LiveView('title')
    other.close(0)
    other._stop()
    assert len(signals) == 1


def test_closing_waits_for_no_page_that_is_not_open(view):
    begun_s = time.monotonic()
    view.close(1)
    assert time.monotonic() - begun_s < 1.4


def test_a_port_that_is_taken_is_named():
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(CampaignError, match=f'--live cannot listen on 127.0.0.1, port {port} '):
            LiveView('title', port=port)


@pytest.mark.parametrize('text', ['-1', '65536', 'http', '80.5', '', '²'])
def test_what_is_no_port_is_refused(text, capsys):
    with pytest.raises(SystemExit) as exit_of:
        argument_parser(['run']).parse_args(['run', 'demo', '-o', 'DIR', f'--live-port={text}'])
    assert exit_of.value.code == 2
    shown = text if text in ('-1', '65536', '80.5') else repr(text)
    assert f'--live-port is {shown}, allowed is a whole number, 0 … 65535' in (
        capsys.readouterr().err)
