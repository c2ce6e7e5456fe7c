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

from pathlib import Path

import pytest

from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_set

PLAN = """\
format_version: 1
title: A small plan
runs: [{scheme: [ff, fbff], periods: 5}]
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(PLAN)
    return path


@pytest.fixture
def rig_file():
    return Path(__file__).parents[2] / 'config' / 'rig.yaml'


@pytest.fixture
def calibrated(rig_file):
    """Return the calibrated rig."""
    return read_parameter_set(rig_file, 'plant', RigParameters)


@pytest.fixture
def models(calibrated, tmp_path, monkeypatch):
    """Write the models of the calibrated rig, as if they had been identified, to work there."""
    monkeypatch.chdir(tmp_path)
    true = calibrated.true_dynamics
    (tmp_path / 'trajectory.yaml').write_text(parameters_yaml('/**', {'trajectory': {
        name: getattr(true, name) for name in DynamicsParameters.names()
        if getattr(true, name) != ()}}))
    (tmp_path / 'compensator.yaml').write_text(parameters_yaml('/**', {
        'compensator': HysteresisParameters.among(calibrated.to_mapping()).to_mapping()}))
    (tmp_path / 'rig.yaml').write_text(parameters_yaml('/**', {'plant': {
        'slew_limit_v_per_s': calibrated.slew_limit_v_per_s}}))
    return tmp_path


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    """Simulate the first run of a plan, given as text; return its bag."""
    def simulate(text):
        directory = tmp_path_factory.mktemp('simulated')
        (directory / 'plan.yaml').write_text(text)
        simulate_run(read_plan(directory / 'plan.yaml').runs[0], directory / 'bag')
        return directory / 'bag'

    return simulate
