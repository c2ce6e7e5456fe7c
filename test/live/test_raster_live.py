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
"""A raster scan live: two rigs in two namespaces give the bits of the offline simulation."""

import os
import re
import signal

import numpy as np
import pytest
import yaml
from processes import wait_until

from piezo_ros.bag import STREAMS, read

# test_raster_rigs.py has what leads the graphs, in memory.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture
def scan_plan(tmp_path, write_plan):
    files = yaml.safe_load(write_plan('ff').read_text())['parameter_files']

    def write(lines):
        path = tmp_path / 'raster.yaml'
        path.write_text(yaml.safe_dump({
            'format_version': 1, 'parameter_files': files,
            'scan_defaults': {'lines': lines, 'pixels': 32, 'slow': {
                'motion': 'preview', 'scheme': 'fbff', 'plant': {'seed': 2},
                'controller': {'reference_delay_samples': 1}}},
            'scans': [{'fast': {
                'motion': 'learned', 'learning_runs': 1, 'scheme': 'ff', 'amplitude_um': 1.0,
                'frequency_hz': 1000.0}}]}))
        return path

    return write


@pytest.mark.parametrize('processes', ['--separate', '--composed'])
def test_live_scans_have_the_bits_of_offline_ones(rig, scan_plan, tmp_path, processes):
    plan = scan_plan(4)
    offline = rig.piezo('simulate', plan, '-o', tmp_path / 'offline')
    assert offline.wait(280) == 0, offline.output
    live = rig.piezo('run', plan, '-o', tmp_path / 'live', processes)
    assert live.wait(280) == 0, live.output
    bags = sorted(
        path.parent.relative_to(tmp_path / 'offline')
        for path in (tmp_path / 'offline').rglob('metadata.yaml'))
    assert len(bags) == 3  # the learning run, and both axes
    namespaces, in_step = set(), set()
    for bag in bags:
        run, expected = read(tmp_path / 'live' / bag), read(tmp_path / 'offline' / bag)
        for stream in STREAMS:
            np.testing.assert_array_equal(run.whole(stream)[1], expected.whole(stream)[1])
        namespaces.add(run.namespace)
        # Nothing of the process that made them.
        assert not re.search(r'piezo_\d', str(run.parameters))
        in_step |= {
            values['lockstep_with'] for name, values in run.parameters.items()
            if name.endswith('/trajectory')}
    assert {name.rpartition('/')[2] for name in namespaces} == {'fast', 'slow'}
    assert in_step == {'', '../fast', '../slow'}
    figures = [
        re.search(r'"rms_px": \S+', (tmp_path / how / 'report.json').read_text())[0]
        for how in ('live', 'offline')]
    assert figures[0] == figures[1]


def test_an_axis_that_dies_ends_both_and_is_named(rig, scan_plan, tmp_path):
    command = rig.piezo('run', scan_plan(5_000), '-o', tmp_path / 'out', '--separate')
    bags = tmp_path / 'out' / 'bags'
    command.wait_for('[1/1]')
    log = wait_until(
        lambda: next(iter((tmp_path / 'out' / 'logs').glob('*_slow/recorder.log')), None),
        'the slow axis', timeout_s=240.0)
    wait_until(
        lambda: sum(path.stat().st_size > 50_000 for path in bags.rglob('*.mcap')) == 2,
        'samples of both axes', timeout_s=240.0)
    victims = [
        pid for pid in map(int, filter(str.isdigit, os.listdir('/proc')))
        if _is_plant_of_slow_axis(pid, command.pid)]
    assert len(victims) == 1
    os.kill(victims[0], signal.SIGKILL)
    assert command.wait(180) == 1
    assert 'slow axis: plant was killed by SIGKILL' in command.output
    assert 'fast axis' not in command.output
    assert 'Traceback' not in command.output
    assert log.is_file()
    assert read(bags / os.listdir(bags)[0] / 'fast').samples > 0


def _is_plant_of_slow_axis(pid, parent):
    try:
        with open(f'/proc/{pid}/cmdline', encoding='utf-8') as file:
            words = file.read().split('\0')
        with open(f'/proc/{pid}/stat', encoding='utf-8') as file:
            is_child = int(file.read().rpartition(')')[2].split()[1]) == parent
    except OSError:
        return False
    return is_child and 'plant' in words and any(word.endswith('/slow') for word in words)
