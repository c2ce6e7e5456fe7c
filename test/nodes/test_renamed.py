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

"""Renamed nodes and remapped streams: right parameters, right samples, a bag that is read."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.bag import STREAMS, read
from piezo_ros.cli.main import main
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_file

CONFIG = Path(__file__).parents[2] / 'config'
FILES = {'plant': 'rig', 'compensator': 'compensator', 'controller': 'controller',
         'trajectory': 'trajectory'}
NAMES = {'plant': 'stage', 'controller': 'pi'}
PERIODS = 5.0
REMAPPED = ('-r', 'displacement:=sensor/position', '-r', 'voltage:=drive')


@pytest.fixture
def expected():
    """Return the streams of the run that config/ describes."""
    values = {
        role: read_parameter_file(CONFIG / f'{file}.yaml', [role])[role]
        for role, file in FILES.items()}
    values['trajectory']['periods'] = PERIODS
    return simulate(
        RigParameters.among(values['plant']), HysteresisParameters.among(values['compensator']),
        ControllerParameters.among(values['controller']),
        TrajectoryParameters.among(values['trajectory']))


def _record(rig, words=()):
    """Run the loop with other names; return the bag."""
    bag = rig.directory / 'bag'
    recorder = rig.start_node('recorder', '-p', f'bag_directory:={bag}', *REMAPPED, *words)
    processes = [
        rig.start_node(
            role, *(('-r', f'__node:={NAMES[role]}') if role in NAMES else ()), *REMAPPED,
            '--params-file', str(CONFIG / f'{file}.yaml'), '-p', 'required_readers:=2',
            '-p', 'linger_s:=-1.0', '-p', 'handshake_timeout_s:=60.0', '-p', 'watchdog_s:=60.0',
            '-p', f'periods:={PERIODS}')
        for role, file in FILES.items()]
    assert recorder.wait() == 0, recorder.output
    for process in processes:
        process.send(signal.SIGINT)
        assert process.wait() == 0, process.output
        assert 'ERROR' not in process.output
    return bag


def test_b13_a_renamed_plant_with_remapped_streams_gives_the_same_run(rig, expected, tmp_path):
    bag = _record(rig)
    run = read(bag)
    assert run.streams == tuple(STREAMS)
    np.testing.assert_array_equal(run.displacement_um, expected.displacement_um[:run.samples])
    np.testing.assert_array_equal(run.voltage_v, expected.voltage_v)
    assert run.namespace == rig.namespace
    assert run.parameters[f'{rig.namespace}/stage']['slew_limit_v_per_s'] == 18200.0
    assert run.metadata['seed'] == '1'
    assert run.metadata['scheme'] == 'fbff'
    # What people do with a bag.
    assert main(['report', str(bag), '-o', str(tmp_path / 'report')]) == 0
    (told,) = json.loads((tmp_path / 'report' / 'report.json').read_text())['runs']
    assert told['nrmse_percent'] == pytest.approx(1.2, abs=0.2)
    assert main(['replay', str(bag)]) == 0
    assert main(['bag', 'info', str(bag)]) == 0
