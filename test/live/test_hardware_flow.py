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

"""A stage of one's own on a device: the flow of the README gives the simulated plant's bits."""

import shutil

import numpy as np
import pytest
from processes import ROOT

from piezo_ros.bag import open_recording, read

STAGE = ROOT / 'config' / 'examples' / 'slow_stage'
SCAN = """
format_version: 1
parameter_files: [rig.yaml, compensator.yaml]
sample_period_s: 1e-4
score_periods: 4
runs:
  - {scheme: ff, waveform: triangle, amplitude_um: 20.0, frequency_hz: 10.0, harmonics: 19,
     periods: 8, ramp_periods: 1,
     controller: {command_minimum_um: -50.0, command_maximum_um: 50.0}PLANT}
"""
COMPENSATOR = """
/**/compensator:
  ros__parameters: {kappa_um_per_v: [25.0, 60.0, 10.0], saturation_v: [0.02, 0.06]}
"""


def assert_same_bags(directory, other):
    bags = sorted((directory / 'bags').iterdir())
    assert bags
    for bag in bags:
        ours, theirs = read(bag), read(other / 'bags' / bag.name)
        assert ours.streams == theirs.streams
        for stream in ours.streams:
            np.testing.assert_array_equal(ours.whole(stream)[1], theirs.whole(stream)[1])
        metadata = open_recording(bag).metadata
        assert metadata['device'].startswith('simulated stage')
        assert metadata['device_rate_hz'] == '10000.0'
        assert metadata['device_voltage_before_v'] == metadata['device_voltage_after_v'] == '0.0'


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_identification_and_scan_have_the_bits_of_the_simulated_plant(rig):
    folder = rig.directory / 'stage'
    shutil.copytree(STAGE, folder)
    (folder / 'compensator.yaml').write_text(COMPENSATOR)
    for name, text in (('identify', (folder / 'identify.yaml').read_text()), ('scan', SCAN)):
        plain, device = folder / f'{name}.yaml', folder / f'{name}_device.yaml'
        plain.write_text(text.replace('PLANT', ''))
        device.write_text(text.replace('PLANT', ', plant: {device: simulated}').replace(
            '    harmonics: 0\n', '    harmonics: 0\n    plant: {device: simulated}\n'))
        simulated, run = folder / f'{name}_simulated', folder / f'{name}_run'
        assert rig.piezo('simulate', plain, '-o', simulated).wait(240.0) == 0
        assert rig.piezo('run', device, '-o', run).wait(240.0) == 0
        assert_same_bags(run, simulated)
