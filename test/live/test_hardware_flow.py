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

"""
A stage of one's own on a device: the flow of the README gives the simulated plant's bits.

On a virtual card, through its device server, with what a real one would be driven by.
"""

import shutil

import numpy as np
import pytest
import yaml
from processes import ROOT, has_ni

from piezo_ros.bag import open_recording, read
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_file

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


# Powers of two and no offset: volts at the connectors are turned into deviations without rounding.
IDEAL = {
    'operating_point_v': 0.0, 'voltage_minimum_v': -5.0, 'voltage_maximum_v': 5.0,
    'sensor_scale_um_per_v': 16.0, 'dac_bits': 0, 'adc_bits': 0}
STEP_UM = 10.0 * 20.0 / 2**16 + 16.0 * 20.0 / 2**18  # of both converters, at 10 um/V


class Lab:
    """The example stage in a folder, and the five commands on a card or on the simulated plant."""

    def __init__(self, rig, bits):
        self._rig, self._bits = rig, bits
        self.folder = rig.directory / 'stage'
        shutil.copytree(STAGE, self.folder)
        values = read_parameter_file(STAGE / 'rig.yaml', ['plant'])['plant']
        self.values = {**values, **IDEAL}
        (self.folder / 'rig.yaml').write_text(parameters_yaml('/**', {'plant': self.values}))

    def piezo(self, *words):
        command = self._rig.piezo(*words)
        # A model that is good up to some frequency only ends with 4.
        assert command.wait(240.0) in (0, 4), command.output
        return command.output

    def _plan(self, name, results, **plant):
        """Write a plan with one run for each run of the example, from some folder of results."""
        plan = yaml.safe_load((STAGE / f'{name}.yaml').read_text())
        plan['parameter_files'] = [
            'rig.yaml', *(f'{results}/{file}' for file in plan['parameter_files'][1:])]
        for run in plan['runs']:
            if 'scheme' in run:
                run['scheme'] = 'ff'
            if plant:
                # A stage without past for each run, as the simulated plant has.
                address = self._rig.start_emulator(
                    'daqmx.daqmx_server', '--rig', self.folder / 'rig.yaml', '--bits',
                    *self._bits)[1]
                run['plant'] = {**plant, 'address': address}
        path = self.folder / f'{name}_{results}.yaml'
        path.write_text(yaml.safe_dump(plan))
        return path

    def drive(self, name, results, **plant):
        """Run a plan of the example; return the bags."""
        path = self._plan(name, results, **plant)
        out = self.folder / results / name
        if plant:
            self.piezo('run', path, '-o', out, '--yes')
        else:
            self.piezo('simulate', path, '-o', out)
        return sorted((out / 'bags').iterdir())

    def identify(self, results, bags):
        """Do the three commands between the first drive and the scan; return what they print."""
        out = self.folder / results
        compensator, trajectory = out / 'compensator.yaml', out / 'trajectory.yaml'
        return [
            self.piezo('identify', 'hysteresis', bags[0], '-o', compensator),
            self.piezo('identify', 'dynamics', bags[1], '--compensator', compensator,
                       '-o', trajectory),
            self.piezo('tune', trajectory, '--compensator', compensator, '--plant',
                       self.folder / 'rig.yaml', '--bound', 'none', '--sample-period-s', '1e-4',
                       '-o', out / 'controller.yaml')]


CARD = {'device': 'ni', 'demagnetise': False}


def readings(bags):
    return [read(bag).whole('displacement')[1] for bag in bags]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not has_ni(), reason='nidaqmx[grpc] is not installed')
@pytest.mark.parametrize('bits', [(0, 0), (16, 18)], ids=['ideal', '16 and 18 bits'])
def test_the_five_commands_on_a_card_give_the_figures_of_the_simulated_plant(rig, bits):
    lab = Lab(rig, bits)
    is_ideal = bits == (0, 0)
    wanted, found = lab.drive('identify', 'simulated'), lab.drive('identify', 'card', **CARD)
    for ours, theirs in zip(readings(found), readings(wanted), strict=True):
        compare(ours, theirs, is_ideal=is_ideal)
    told = [lab.identify(results, bags) for results, bags in (
        ('simulated', wanted), ('card', found))]
    if is_ideal:
        assert told[0] == [text.replace('/card/', '/simulated/') for text in told[1]]
    wanted, found = lab.drive('scan', 'simulated'), lab.drive('scan', 'card', **CARD)
    (ours,), (theirs,) = readings(found), readings(wanted)
    compare(ours, theirs, is_ideal=is_ideal)


def compare(ours_um, theirs_um, *, is_ideal):
    """Assert that readings are the same, but for the resolution of the converters."""
    if is_ideal:
        np.testing.assert_array_equal(ours_um, theirs_um)
        return
    difference_um = ours_um - theirs_um
    assert 0.0 < difference_um.std() < STEP_UM
