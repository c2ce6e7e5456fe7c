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

"""A graph that is kept for all runs of a plan: runs of every kind in turn, and its end."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.bag import read
from piezo_ros.experiment.run_replay import replay

ROOT = Path(__file__).parents[2]
RUNS = [
    {'scheme': 'fbff', 'periods': 2},
    {'scheme': 'fbff', 'periods': 2},  # nothing of the first is left
    {'output': 'voltage', 'amplitude_v': 2.0, 'waveform': 'triangle', 'harmonics': 0},
    {'scheme': 'open_loop', 'waveform': 'stepped_sine', 'amplitude_um': 0.3, 'harmonics': 0,
     'dwell_s': 0.01, 'trajectory': {'frequencies_hz': [500.0, 2000.0]}},
    {'scheme': 'fb', 'periods': 2},
    {'scheme': 'ff', 'periods': 2, 'plant': {'noise_rms_um': 0.0}},
    {'scheme': 'ff', 'periods': 2, 'changes': [
        {'at_sample': 250, 'scheme': 'fbff', 'proportional_gain': 0.4},
        {'at_sample': 251, 'integral_gain_per_s': 3000.0},
        {'at_sample': 400, 'scheme': 'open_loop'},
        {'at_sample': 550, 'scheme': 'fb', 'command_maximum_um': 0.5}]},
    {'scheme': 'open_loop', 'periods': 1, 'controller': {'measurement_delay_samples': 3},
     'changes': [{'at_sample': 2, 'scheme': 'fb'}, {'at_sample': 300, 'scheme': 'ff'}]},
]


@pytest.fixture
def plan(tmp_path):
    def write(runs):
        path = tmp_path / 'plan.yaml'
        path.write_text(yaml.safe_dump({
            'format_version': 1, 'score_periods': 1, 'runs': runs,
            'parameter_files': [
                str(ROOT / 'config' / f'{name}.yaml')
                for name in ('rig', 'compensator', 'controller', 'trajectory')]}))
        return path
    return write


def test_runs_of_every_kind_follow_each_other_with_the_bits_of_the_offline_simulation(rig, plan):
    rig.measure()
    path = plan(RUNS)
    live = rig.piezo('run', path, '-o', rig.directory / 'live', '--keep')
    offline = rig.piezo('simulate', path, '-o', rig.directory / 'offline')
    assert live.wait(180) == 0, live.output
    assert offline.wait(180) == 0, offline.output
    bags = sorted((rig.directory / 'live' / 'bags').iterdir())
    assert len(bags) == len(RUNS)
    for bag in bags:
        run, expected = read(bag), read(rig.directory / 'offline' / 'bags' / bag.name)
        assert run.streams == expected.streams
        for stream in run.streams:
            np.testing.assert_array_equal(run.whole(stream)[1], expected.whole(stream)[1])
        assert len(run.parameters) == (2 if 'bare' in bag.name else 4)
        if 'bare' not in bag.name:
            assert replay(run).is_faithful
    assert not rig.nodes()


@pytest.mark.parametrize(('victim', 'number', 'words'), [
    pytest.param('loop', signal.SIGKILL, 'loop was killed by SIGKILL', marks=pytest.mark.slow),
    pytest.param(
        'recorder', signal.SIGKILL, 'recorder was killed by SIGKILL', marks=pytest.mark.slow),
    pytest.param('', signal.SIGINT, 'stopped by SIGINT', marks=pytest.mark.slow),
])
def test_whatever_dies_the_bag_is_readable_and_nothing_is_left(
        rig, plan, until, victim, number, words):
    process = rig.piezo(
        'run', plan([{'scheme': 'fbff', 'periods': 3000}]), '-o', rig.directory / 'out', '--keep')
    bag = rig.directory / 'out' / 'bags' / '000_fbff_triangle_1um_300hz'
    until(
        lambda: process.exit_code is not None
        or sum(file.stat().st_size for file in bag.glob('*.mcap')) > 50_000, 'a growing bag')
    assert process.exit_code is None, process.output
    os.kill(rig.nodes()[victim] if victim else process.pid, number)
    assert process.wait(60) == 1
    assert words in process.output
    assert not rig.nodes()
    assert read(bag).samples > 0
