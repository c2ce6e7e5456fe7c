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

"""``piezo identify creep``: a bag to a parameter file of the compensator."""

import pytest
import yaml

from piezo_ros.cli.main import main
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.model import CompensatorParameters
from piezo_ros.parameters.parameter_file import read_parameter_set


def test_creep_of_a_long_step_is_identified_and_its_file_loads(tmp_path, capsys):
    path = tmp_path / 'plan.yaml'
    path.write_text(
        'format_version: 1\nparameter_files: []\nsample_period_s: 0.02\nscore_periods: 1\nruns:\n'
        '- {output: voltage, waveform: staircase, stairs: 1, amplitude_v: 2.0,\n'
        '   frequency_hz: 0.025, periods: 1, harmonics: 0, plant: {creep_per_decade: 0.02}}\n')
    simulate_run(read_plan(path).runs[0], tmp_path / 'bag')
    output = tmp_path / 'creep.yaml'
    code = main(['identify', 'creep', str(tmp_path / 'bag'), '-o', str(output)])
    out = capsys.readouterr().out
    assert code == 0
    assert 'verdict: usable up to' in out
    fitted = read_parameter_set(output, 'compensator', CompensatorParameters)
    error = yaml.safe_load(output.read_text())['/**/identified_creep']['ros__parameters'][
        'creep_standard_error']
    assert abs(fitted.creep_per_decade - 0.02) < 3.0 * error < 0.006
    assert output.with_suffix('.svg').is_file()
    code = main(['identify', 'creep', str(tmp_path / 'bag'), '-o', str(output)])
    assert (code, 'exists; --force replaces it' in capsys.readouterr().err) == (2, True)


@pytest.mark.slow
def test_a_bag_that_cannot_tell_is_named(tmp_path, capsys):
    path = tmp_path / 'plan.yaml'
    path.write_text(
        'format_version: 1\nparameter_files: []\nruns:\n'
        '- {output: voltage, waveform: triangle, amplitude_v: 2.0, harmonics: 0}\n')
    simulate_run(read_plan(path).runs[0], tmp_path / 'bag')
    code = main(['identify', 'creep', str(tmp_path / 'bag'), '-o', str(tmp_path / 'creep.yaml')])
    error = capsys.readouterr().err
    assert code == 1
    assert f'{tmp_path / "bag"}: the voltage is held for 0 % of the record' in error
    assert '--compensator FILE' in error
    assert not (tmp_path / 'creep.yaml').exists()
