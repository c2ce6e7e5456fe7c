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

"""The four commands of the example measured_stage, on a stage that the package knows nothing of."""

import shlex
from pathlib import Path

import measured_stage
import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.bag.tables.import_table import ImportChoice, import_table
from piezo_ros.cli.main import main
from piezo_ros.experiment.plan.packaged_plans import examples

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = (
    REPOSITORY / 'config/examples/measured_stage/README.md', REPOSITORY / 'docs/measured-stage.md')


def commands(page):
    """Return the commands of piezo in a page, as a shell would take them apart."""
    text = page.read_text(encoding='utf-8').replace('\\\n', ' ')
    return [
        shlex.split(line)[1:] for line in text.splitlines() if line.startswith('    piezo ')]


def test_the_measurement_of_the_example_is_that_of_the_stage(tmp_path):
    measured_stage.write_measurement(tmp_path / 'stage.csv')
    assert (tmp_path / 'stage.csv').read_text(encoding='utf-8') == (
        examples()['measured_stage'] / 'stage.csv').read_text(encoding='utf-8')


def test_the_measurement_becomes_a_bag_about_its_operating_point(tmp_path):
    import_table(
        examples()['measured_stage'] / 'stage.csv', tmp_path / 'stage', ImportChoice(
            {'time': '1', 'voltage': '2', 'displacement': '3'}, {'voltage': 15.0},
            {'voltage': 4.0, 'displacement': 'rest'}))
    run = read(tmp_path / 'stage')
    input_v = measured_stage.excitation_v()
    true_um = measured_stage.stage_displacement_um(15.0 * input_v)
    assert run.sample_period_s == pytest.approx(1.0 / measured_stage.SAMPLE_RATE_HZ, rel=1e-12)
    assert run.voltage_v == pytest.approx(15.0 * input_v, abs=2e-4)
    assert run.displacement_um == pytest.approx(true_um, abs=6.0 * measured_stage.NOISE_UM)


def test_the_page_and_the_example_have_the_same_commands():
    example, page = map(commands, PAGES)
    assert [command for command in page if command in example] == example
    assert [command[0] for command in example[:4]] == ['bag', 'identify', 'identify', 'simulate']


@pytest.mark.slow
def test_four_commands_lead_from_a_csv_to_a_scan_that_the_stage_follows(
        tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(['init', 'measured_stage']) == 0
    monkeypatch.chdir(tmp_path / 'measured_stage')
    for command in commands(Path('README.md')):
        words = [
            str(found) for word in command
            for found in (sorted(Path().glob(word)) if '*' in word else [word])]
        assert main(words) == 0, words
    notes = capsys.readouterr().err
    assert 'the simulated rig is made of identified models' in notes
    assert 'compensator.yaml: good' in notes
    # The voltages of the scan on the stage itself, which no model has seen.
    scan = np.genfromtxt('scan.csv', delimiter=',', names=True)
    last = slice(-round(4 * measured_stage.SAMPLE_RATE_HZ / 10.0), None)
    reference_um = scan['reference_um'][last]

    def nrmse_percent(displacement_um):
        error_um = reference_um - displacement_um[last]
        return 100.0 * np.sqrt(np.mean(error_um**2)) / np.ptp(reference_um)

    compensated = nrmse_percent(measured_stage.stage_displacement_um(scan['voltage_v']))
    gain = np.ptp(scan['displacement_um']) / np.ptp(scan['voltage_v'])
    linear = nrmse_percent(measured_stage.stage_displacement_um(scan['reference_um'] / gain))
    assert compensated < 0.5
    assert linear > 3.0
