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

"""Devices of other makers' emulators in the graph of `piezo run`: what comes back, what is lost."""

import os
import shutil
import signal

import numpy as np
import pytest
from processes import busy_processes, has_ni, wait_until

from piezo_ros.bag import BagError, open_recording, read, salvage
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.parameters.parameter_file import parameters_yaml

CYCLE_S = 5e-5  # of the servo of the emulated controller


def plan(directory, sample_period_s, frequency_hz, *, periods=30, **plant):
    path = directory / 'plan.yaml'
    words = ', '.join(f'{name}: {value}' for name, value in plant.items())
    path.write_text(f"""
format_version: 1
sample_period_s: {sample_period_s}
score_periods: 1
runs:
  - scheme: ff
    waveform: sine
    amplitude_um: 2.0
    frequency_hz: {frequency_hz}
    harmonics: 1
    periods: {periods}
    ramp_periods: 1
    plant: {{demagnetise: false, {words}}}
""", encoding='utf-8')
    return path


def the_bag(out):
    (bag,) = (out / 'bags').iterdir()
    return bag


def recorded_samples(out, stream):
    """Return how many samples of a stream are in the bag of a run that goes on."""
    so_far = out.parent / 'so_far'
    shutil.rmtree(so_far, ignore_errors=True)
    try:
        salvage(the_bag(out), so_far)
        return read(so_far).whole(stream)[1].size
    except (BagError, OSError, ValueError):  # there is none yet
        return 0


def test_a_run_on_a_controller_is_aligned_and_what_its_recorder_holds(rig):
    rig.measure()
    from gcs.virtual_controller import VirtualController, served
    controller = VirtualController(RigParameters(noise_rms_um=0.0))
    out = rig.directory / 'out'
    with served(controller) as (_, address):
        path = plan(rig.directory, CYCLE_S, 200.0, periods=5, device='gcs', address=address)
        command = rig.piezo('run', path, '-o', out, '--yes')
        assert command.wait() == 0, command.output
    run = read(the_bag(out))
    voltage_v, displacement_um = (run.whole(name)[1] for name in ('voltage', 'displacement'))
    # To all of its six printed decimals, and each in the row of its voltage.
    first, last = controller.faults.delay_cycles, controller.faults.delay_cycles + voltage_v.size
    recorded_um = np.array([float(f'{row:.6f}') for row in controller.rows[:, 0].tolist()])
    np.testing.assert_array_equal(displacement_um[1:], recorded_um[first + 1:last + 1] - 6.0)
    np.testing.assert_allclose(
        controller.rows[first:last, 1], 8.0 * (6.0 + 1.2 * voltage_v) - 20.0, rtol=0.0, atol=1e-9)
    stage = Rig(RigParameters(noise_rms_um=0.0), CYCLE_S, compiled=False)
    np.testing.assert_allclose(
        displacement_um, [stage.measure(), *stage.run(voltage_v)], rtol=0.0, atol=6e-7)
    assert np.ptp(displacement_um) > 3.0
    metadata = open_recording(the_bag(out)).metadata
    assert 'E-727.1CD' in metadata['device']
    assert float(metadata['device_rate_hz']) == pytest.approx(20e3)


@pytest.mark.skipif(not has_ni(), reason='nidaqmx[grpc] is not installed')
def test_a_device_server_that_dies_ends_the_run_by_name_with_an_unknown_voltage(rig):
    out = rig.directory / 'out'
    server, address = rig.start_emulator('daqmx.daqmx_server', '--wall-clock', 1)
    command = rig.piezo(
        'run', plan(rig.directory, 1e-3, 5.0, device='ni', address=address, read_samples=10),
        '-o', out, '--yes')
    # The card goes on by its own clock, whether what it reads is fetched or not.
    wait_until(lambda: recorded_samples(out, 'displacement') > 200, 'readings in the bag')
    server.send(signal.SIGKILL)
    assert command.wait() == 1
    assert not rig.nodes()
    assert f'plant failed: Dev1 at {address}' in command.output
    assert 'the device server does not answer' in command.output
    assert 'the voltage is unknown' in command.output
    assert 'Traceback' not in command.output
    readings_um = read(the_bag(out)).whole('displacement')[1]
    assert readings_um.size > 200
    assert np.isfinite(readings_um).all()


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(not has_ni(), reason='nidaqmx[grpc] is not installed')
@pytest.mark.parametrize('clock', ['of its calls', 'of the wall'])
def test_ten_streamed_seconds_at_100_khz_are_the_readings_of_the_rig(rig, clock):
    options = ('--wall-clock', 1) if clock == 'of the wall' else ()
    command, run = ten_seconds(rig, options, prefill_samples=100_000, read_samples=5000)
    if options and 'ran out of samples' in command.output:
        pytest.skip(f'this machine is too busy for its own clock: {command.output}')
    assert_whole_seconds(command, run)
    assert open_recording(the_bag(rig.directory / 'out')).metadata['device_played'] == 'streamed'


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(not has_ni(), reason='nidaqmx[grpc] is not installed')
def test_ten_prefilled_seconds_at_100_khz_do_not_run_dry_however_busy_the_machine_is(rig):
    with busy_processes(2 * (os.cpu_count() or 1)):
        command, run = ten_seconds(
            rig, ('--wall-clock', 1), prefill_samples=0, buffer_samples=1_200_000)
    assert_whole_seconds(command, run)
    assert open_recording(the_bag(rig.directory / 'out')).metadata['device_played'] == (
        'whole run prefilled')


def ten_seconds(rig, options, **device):
    """Run a plan on the virtual card; check every reading; return the command and the run."""
    # Powers of two and no offset: volts at the connectors are turned without rounding.
    values = {
        'operating_point_v': 0.0, 'voltage_minimum_v': -5.0, 'voltage_maximum_v': 5.0,
        'sensor_scale_um_per_v': 2.0}
    file, out = rig.directory / 'rig.yaml', rig.directory / 'out'
    file.write_text(parameters_yaml('/**', {'plant': values}))
    _, address = rig.start_emulator('daqmx.daqmx_server', '--rig', file, *options)
    path = plan(
        rig.directory, 1e-5, 100.0, periods=1000, device='ni', address=address,
        **device, **values)
    command = rig.piezo('run', path, '-o', out, '--yes')
    command.wait(300.0)
    run = read(the_bag(out))
    voltage_v, displacement_um = (run.whole(name)[1] for name in ('voltage', 'displacement'))
    stage = Rig(RigParameters(**values), 1e-5, compiled=True)
    expected_um = np.array([stage.measure(), *stage.run(voltage_v)])
    np.testing.assert_array_equal(displacement_um, expected_um[:displacement_um.size])
    return command, run


def assert_whole_seconds(command, run):
    assert command.exit_code == 0, command.output
    assert run.whole('displacement')[1].size == 1_000_001
    assert not run.lost
