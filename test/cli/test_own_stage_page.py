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


"""The tables of docs/your-own-stage.md are those that its commands print, and they come true."""

import re

import pytest
from printed_outputs import PAGE, STAGE, printed_outputs, with_outputs

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_file, read_parameter_set
from piezo_ros.report.metrics import nrmse, tail

FIGURE = re.compile(r'\d+(?:\.\d+)?(?:e[-+]\d+)?')


@pytest.fixture(scope='module')
def flow(tmp_path_factory):
    directory = tmp_path_factory.mktemp('own_stage')
    return directory, printed_outputs(directory)


@pytest.mark.slow
def test_the_page_shows_what_the_commands_print(flow):
    page = PAGE.read_text(encoding='utf-8')
    # Digits may differ between processors, the words and the columns may not.
    shown, printed = (
        FIGURE.sub('#', text).split() for text in (page, with_outputs(page, flow[1])))
    assert shown == printed, 'run `make outputs`'


@pytest.mark.slow
def test_d1_every_cell_of_the_table_comes_true_within_15_percent(flow):
    directory, outputs = flow
    rig = read_parameter_set(STAGE / 'rig.yaml', 'plant', RigParameters)
    compensator = read_parameter_set(
        directory / 'compensator.yaml', 'compensator', HysteresisParameters)
    gains = read_parameter_file(directory / 'controller.yaml', ['controller'])['controller']
    table = outputs['tune'].partition('(! amplifier at its limits)\n')[2].partition('\n\n')[0]
    header, *rows = (line for line in table.splitlines() if not line.lstrip().startswith('–'))
    frequencies = [float(word) for word in re.findall(r'([\d.]+) Hz', header)]
    cells = 0
    for row in rows:
        amplitude = float(row.split()[0])
        found = re.findall(r'(ff|fbff|fb) (\d+) ([\d.]+)', row)
        for frequency, (scheme, m, percent) in zip(frequencies, found, strict=True):
            scan = read_parameter_set(
                directory / 'trajectory.yaml', 'trajectory', TrajectoryParameters,
                {'sample_period_s': 1e-4}).replaced(
                    amplitude_um=amplitude, frequency_hz=frequency, harmonics=int(m))
            law = ControllerParameters.among({
                **gains, 'scheme': scheme, 'command_minimum_um': -50.0,
                'command_maximum_um': 50.0})
            run = simulate(rig, compensator, law, scan)
            window = tail(scan.samples, frequency, 1e-4, 4.0)
            measured = 100.0 * nrmse(
                run.reference_um[window], run.displacement_um[:scan.samples][window])
            assert float(percent) == pytest.approx(measured, rel=0.15, abs=0.01), (row, frequency)
            cells += 1
    assert cells == 20
