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

"""`piezo run --live` on real nodes: the page sees the run, and its stop is one like any other."""

import json
import re
import urllib.error
import urllib.request

import pytest
import yaml
from processes import ROOT

from piezo_ros.bag import read


def _address(command, until):
    return until(
        lambda: (found := re.search(r'live view: (\S+)', command.output)) and found[1],
        'the address')


def _ask(address, name, method='GET'):
    request = urllib.request.Request(address + name, method=method, headers={
        'Origin': re.match(r'http://[^/]+', address)[0]})
    with urllib.request.urlopen(request, timeout=20) as answer:
        return json.loads(answer.read())


def _rig(address, run, samples):
    """Return what the page is told of the rig, once it has so many samples of a run."""
    for state in _ask(address, 'data')['rigs']:
        if state['run'] == run and len(state['tracking'][0]) >= samples:
            return state
    return None


def _plan(directory, plant, **run):
    path = directory / 'plan.yaml'
    path.write_text(yaml.safe_dump({
        'format_version': 1, 'title': 'a plan', 'score_periods': 1,
        'parameter_files': [
            str(ROOT / 'config' / f'{name}.yaml')
            for name in ('rig', 'compensator', 'controller', 'trajectory')],
        'runs': [{'scheme': 'fbff', 'plant': {'watchdog_s': 60.0, **plant}, **run}]}))
    return path


@pytest.mark.parametrize('processes', [
    '--composed', pytest.param('--separate', marks=pytest.mark.slow)])
def test_the_stop_of_the_page_brings_the_voltage_to_zero(
        rig, tmp_path, until, assert_whole, processes):
    # Slow, so that most of the processor is left to others.
    plan = _plan(tmp_path, {'realtime_factor': 0.02}, periods=30_000)
    command = rig.piezo('run', plan, '-o', rig.directory / 'out', processes, '--live')
    address = _address(command, until)

    state = until(lambda: _rig(address, 1, 12), 'samples on the page')
    assert state['statuses']['plant']['state'] == 'active'
    indices, displacements_um, references_um = state['tracking']
    assert indices == sorted(indices)
    with pytest.raises(urllib.error.HTTPError, match='403'):
        urllib.request.urlopen(urllib.request.Request(address + 'stop', method='POST'))
    assert _ask(address, 'stop', 'POST') == {}
    assert command.wait() == 1
    assert 'stopped by SIGINT; the voltage deviation is 0 V' in command.output
    assert 'stop, by the button of the live view' in command.output
    assert not rig.nodes()
    run = read(rig.bag)
    assert_whole(run)
    assert not run.lost
    # What the page saw is in the bag, the reference of each displacement too.
    for stream, seen in (('displacement', displacements_um), ('reference', references_um)):
        whole = run.whole(stream)[1]
        assert [float(whole[index]) for index in indices] == seen


@pytest.mark.slow
def test_a_run_is_not_hurt_by_those_who_watch_it(rig, tmp_path, until):
    """Silent connections, a closed page: the run ends as it would alone."""
    import socket
    from urllib.parse import urlsplit
    plan = _plan(tmp_path, {}, periods=90)
    command = rig.piezo('run', plan, '-o', rig.directory / 'out', '--composed', '--live')
    port = urlsplit(_address(command, until)).port
    silent = [socket.create_connection(('127.0.0.1', port)) for _ in range(50)]
    for connection in silent[:25]:
        connection.sendall(b'GET / HTTP/1.1\r\n')
    assert command.wait() == 0, command.output
    for connection in silent:
        connection.close()
    assert read(rig.bag).whole('displacement')[1].size == 30_001


@pytest.mark.slow
def test_a_kept_graph_and_each_of_its_runs_are_shown(rig, tmp_path, until):
    plan = _plan(tmp_path, {'realtime_factor': 0.02}, periods=30)
    text = yaml.safe_load(plan.read_text())
    text['runs'] = [{**text['runs'][0], 'scheme': ['fb', 'fbff']}]
    plan.write_text(yaml.safe_dump(text))
    command = rig.piezo('run', plan, '-o', rig.directory / 'out', '--keep', '--live')
    address = _address(command, until)
    for run in (1, 2):
        state = until(
            lambda run=run: _rig(address, run, 5), 'samples on the page')
        # The reference is that of this run, and no sample is one of the run before.
        errors = [
            abs(y - r) for y, r in zip(*state['tracking'][1:], strict=True) if r is not None]
        assert max(errors) < 1.2
        assert 'refused_reference' not in state['analysis']
    assert command.wait() == 0, command.output
