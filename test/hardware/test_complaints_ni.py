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

"""Complaints of users of other packages (R1 to R14), each as a test of the NI device."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.hardware.device import (
    DeviceError,
    RateRefused,
    Refused,
    Reserved,
    Underflow,
)
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.simulated_rig import Rig

TESTS = Path(__file__).resolve().parents[1]
SLEW_V_PER_S = 100.0
WIRE = {'operating_point_v': 0.0, 'sensor_scale_um_per_v': 1.0}


def sine(samples):
    return 1.5 * np.sin(2.0 * np.pi * np.arange(samples) / 200.0)


def rig_readings(voltage_v):
    rig = Rig(compiled=False)
    return np.array([rig.measure(), *rig.run(voltage_v)])


def wired(make_card, **options):
    from daqmx.virtual_card import WireStage
    return make_card(WireStage(), held_v=0.0, **options)


def steps_of(card):
    return np.abs(np.diff(np.concatenate(card.outputs_v)))


def test_r1_a_short_read_has_whole_samples_only(ni, card):
    device = ni(card)
    card.faults.short_reads = [3, 1, 50]
    np.testing.assert_array_equal(device.play(sine(120)), rig_readings(sine(120)))
    assert not card.faults.short_reads


def test_r1_a_read_that_brings_nothing_is_a_fault(ni, card):
    device = ni(card)
    card.faults.short_reads = [0]
    with pytest.raises(DeviceError, match='no reading within 5.00002 s'):
        device.play(sine(10))


def test_r2_channels_go_by_name(ni, make_card):
    device = ni(make_card(), input_channel='Dev1/ai3', **WIRE)
    assert device.reading() == 3.0
    assert [*device.play(np.zeros(5))] == [3.0] * 6
    # What is held is not what another channel shows.
    assert device.hold() == 0.0


def test_r3_one_input_at_a_time_so_that_no_neighbour_bleeds_in(ni, card, monkeypatch):
    channels = []
    added = card.add_channels

    def recorded(name, names, *arguments, **more):
        channels.append(names)
        return added(name, names, *arguments, **more)

    monkeypatch.setattr(card, 'add_channels', recorded)
    device = ni(card)
    device.play(sine(5))
    device.reading()
    assert {*channels} == {'Dev1/ai0', 'Dev1/ao0'}
    assert not [names for names in channels if ',' in names]


@pytest.mark.parametrize('value', ['Dev1/ai0:1', 'Dev1/ai0,Dev1/ai1', 'Dev1/ai0, Dev1/ai1', 'ai0'])
def test_r3_several_inputs_are_refused_by_name(value):
    from piezo_ros.hardware.ni import NiParameters
    with pytest.raises(ParameterError, match=f"input_channel is '{value}', it must be one channel"):
        NiParameters(input_channel=value)


@pytest.mark.parametrize('samples', [1, 2, 3, 10, 257])
def test_r4_an_impulse_is_answered_at_the_next_reading_whatever_the_block(ni, make_card, samples):
    device = ni(wired(make_card), **WIRE)
    for place in {0, samples // 2, samples - 1}:
        device.play([0.0])
        impulse_v = np.zeros(samples)
        impulse_v[place] = 1.0
        readings_um = device.play(impulse_v)
        assert readings_um.size == samples + 1
        assert [*np.flatnonzero(readings_um)] == [place + 1]


@pytest.mark.parametrize('samples', [1, 7, 100])
def test_r4_an_impulse_in_a_stream_too(ni, make_card, samples):
    device = ni(wired(make_card), **WIRE)
    impulse_v = np.zeros(300)
    impulse_v[123] = 1.0
    device.start(impulse_v[:200])
    readings_um = []
    for first in range(200, 300, samples):
        readings_um += [*device.read(samples)]
        device.write(impulse_v[first:first + samples])
    device.finish()
    readings_um += [*device.read(301 - len(readings_um))]
    assert [*np.flatnonzero(readings_um)] == [124]


def test_r5_an_output_without_the_clock_of_the_input_does_not_run(make_card):
    from daqmx.virtual_card import CONTINUOUS, DaqmxFault
    card = make_card()
    card.create_task('out')
    card.add_channels('out', 'Dev1/ao0', -2.0, 10.0, is_output=True)
    card.configure_clock('out', 1e5, '/Dev1/ai/SampleClock', CONTINUOUS, 100)
    card.write('out', [6.0, 7.0], 1.0, False)
    card.start('out')
    with pytest.raises(DaqmxFault) as caught:
        card.wait_until_done('out', 0.0)
    assert caught.value.code == -200560
    assert card.generated('out') == 0
    assert card.held_v['ao0'] == 5.0


def test_r5_a_clock_that_stands_still_gives_no_readings(ni, card):
    device = ni(card)
    card.faults.clock_stands = True
    with pytest.raises(DeviceError, match='its clock stands still'):
        device.play(sine(10))
    card.faults.clock_stands = False
    assert device.play(sine(10)).size == 11


@pytest.mark.parametrize('samples', [1, 2, 5, 999, 1001])
def test_r6_exactly_the_samples_written_are_played(ni, card, samples):
    device = ni(card)
    before = sum(map(len, card.outputs_v))
    device.play(sine(samples))
    # A finite output has two samples at least; one is played as two equal ones.
    assert sum(map(len, card.outputs_v)) - before == max(samples, 2)


def test_r6_the_emulator_repeats_a_buffer_that_is_too_short(card):
    from daqmx.virtual_card import FINITE
    for name, channel in (('in', 'Dev1/ai0'), ('out', 'Dev1/ao0')):
        card.create_task(name)
        card.add_channels(name, channel, -10.0, 10.0, is_output=name == 'out')
        card.configure_clock(name, 1e5, '/Dev1/ai/SampleClock', FINITE, 1000)
    card.write('out', np.full(5, 5.0), 1.0, False)
    card.start('out')
    card.start('in')
    card.read('in', 1000, 1.0)
    assert card.generated('out') == 1000


def test_r7_a_rate_that_the_clock_does_not_make_is_refused_by_name(ni, card):
    device = ni(card, None)
    with pytest.raises(RateRefused) as caught:
        device.open(1.0 / 30e3)
    assert '29985' in str(caught.value)
    assert 'sample_period_s is 3.33' in str(caught.value)
    # The one that it names is taken.
    device.open(667 / 20e6)
    assert device.play(sine(3)).size == 4


def test_r7_a_rate_that_is_not_the_one_asked_for_is_found_at_every_block(ni, card):
    device = ni(card)
    card.faults.rate_factor = 1.0 + 1e-6
    with pytest.raises(RateRefused):
        device.play(sine(3))


@pytest.mark.parametrize('read', [1, 2, 57, 300, 399])
def test_r8_after_an_interruption_the_output_ramps_to_rest(ni, card, read):
    class Interruption(BaseException):
        pass

    device = ni(card)
    device.play(ramp_voltage(0.0, 0.5, SLEW_V_PER_S, 1e-5))
    slow_v = 0.5 + 0.01 * np.sin(np.arange(400) / 50.0)
    before = sum(map(len, card.outputs_v))

    def run():
        try:
            device.start(slow_v)
            device.read(read)
            raise Interruption
        finally:
            device.ramp_to(0.0, SLEW_V_PER_S)

    with pytest.raises(Interruption):
        run()
    assert card.held_v['ao0'] == 5.0
    assert steps_of(card)[before:].max() <= SLEW_V_PER_S * 1e-5 * (1.0 + 1e-9)


@pytest.mark.parametrize('held_v', [-2.0, 0.0, 7.3, 10.0])
def test_r9_nothing_jumps_at_the_start_at_the_end_or_between_runs(ni, make_card, held_v):
    card = make_card(held_v=held_v)
    device = ni(card)
    assert device.hold() == pytest.approx(held_v - 5.0)
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.play(ramp_voltage(0.0, 0.2, SLEW_V_PER_S, 1e-5))
    device.close()
    device.open(1e-5)
    device.start(ramp_voltage(0.2, 0.1, SLEW_V_PER_S, 1e-5))
    device.read(5)
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    assert card.held_v['ao0'] == 5.0
    assert steps_of(card).max() <= SLEW_V_PER_S * 1e-5 * (1.0 + 1e-9)


def test_r9_a_coarse_card_jumps_by_its_resolution_at_most(ni, make_card):
    card = make_card(held_v=7.3, dac_bits=16, adc_bits=18)
    ni(card).ramp_to(0.0, SLEW_V_PER_S)
    assert steps_of(card).max() <= SLEW_V_PER_S * 1e-5 + 2.0 * 20.0 / 2**16
    assert card.held_v['ao0'] == 5.0


def test_r10_no_events_are_used(card, serve):
    from piezo_ros.hardware.ni import NiDevice, NiParameters
    service, address = serve(card)
    device = NiDevice(NiParameters(address=address))
    device.open(1e-5)
    device.start(sine(10))
    device.read(5)
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    assert service.log
    assert not [request for request in service.log if 'Register' in type(request).__name__]


CLIENT = """
import sys
from piezo_ros.hardware.ni import NiDevice, NiParameters
device = NiDevice(NiParameters(address=sys.argv[1]))
device.open(1e-5)
device.start([0.001 * min(k, 900) for k in range(1000)])
device.read(700)
print('running', flush=True)
sys.stdin.read()
"""


@pytest.fixture
def client(serve, card):
    """Start a client in a process of its own, which has a stream running."""
    _, address = serve(card)
    process = subprocess.Popen(
        [sys.executable, '-c', CLIENT, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        text=True, cwd=TESTS.parent)
    try:
        assert process.stdout.readline() == 'running\n'
        yield process, address
    finally:
        process.kill()
        process.communicate()


def test_r11_after_kill_9_the_output_holds_and_the_next_start_works(client, card):
    from piezo_ros.hardware.ni import NiDevice, NiParameters
    process, address = client
    device = NiDevice(NiParameters(address=address, timeout_s=5.0))
    with pytest.raises(Reserved, match=f'process {process.pid} of this machine holds it'):
        device.open(1e-5)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    held_v = card.held_v['ao0']
    assert held_v == 5.0 + 0.001 * 699
    assert len(card.tasks) == 2
    device.open(1e-5)
    assert card.held_v['ao0'] == held_v
    assert not card.tasks
    before = sum(map(len, card.outputs_v))
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    assert steps_of(card)[before - 1:].max() <= SLEW_V_PER_S * 1e-5 * (1.0 + 1e-9)
    assert card.held_v['ao0'] == 5.0


def test_r11_a_card_that_another_program_holds_is_told(ni, card):
    device = ni(card)
    card.faults.reserved = True
    for call in (lambda: device.play(sine(3)), device.hold, lambda: device.set_output(0.0)):
        with pytest.raises(Reserved, match='another program or session holds it'):
            call()
    card.faults.reserved = False
    device.play(sine(3))


@pytest.mark.parametrize('samples', [1, 2, 99, 100, 101, 200, 201])
def test_r12_there_are_as_many_readings_as_there_should_be(ni, card, samples, monkeypatch):
    from piezo_ros.hardware import ni_tasks
    monkeypatch.setattr(ni_tasks, '_PIECE', 100)
    device = ni(card)
    np.testing.assert_array_equal(device.play(sine(samples)), rig_readings(sine(samples)))
    device.start(np.full(samples, sine(samples)[-1]))
    device.finish()
    assert device.read(samples + 1).size == samples + 1


@pytest.mark.slow
def test_r12_a_block_larger_than_a_message(make_card, serve):
    from piezo_ros.hardware.ni import NiDevice, NiParameters
    device = NiDevice(NiParameters(address=serve(wired(make_card))[1], **WIRE))
    device.open(1e-5)
    block_v = np.arange(600_000) % 1000 / 1000.0
    readings_um = device.play(block_v)
    device.close()
    np.testing.assert_array_equal(readings_um[1:], block_v)


def test_r13_a_stream_that_starves_ends_with_its_index(ni, card):
    device = ni(card)
    device.start(sine(150))
    assert device.read(100).size == 100
    card.faults.ticks_before_read = 200
    with pytest.raises(Underflow, match='ran out of samples at index 150') as caught:
        device.read(100)
    assert caught.value.index == 150
    card.faults.ticks_before_read = 0
    # What answers a voltage can still be fetched; what is written now comes too late.
    np.testing.assert_array_equal(device.read(51), rig_readings(sine(150))[100:])
    with pytest.raises(Underflow):
        device.read(1)
    with pytest.raises(Underflow) as caught:
        device.write(sine(10))
    assert caught.value.index == 150
    device.ramp_to(0.0, SLEW_V_PER_S)
    assert card.held_v['ao0'] == 5.0


def test_r13_a_slow_writer_too(ni, card):
    device = ni(card)
    device.start(sine(150))
    device.read(100)
    card.faults.ticks_before_write = 60
    with pytest.raises(Underflow) as caught:
        device.write(sine(10))
    assert caught.value.index == 150


def test_r14_software_timed_and_clocked_outputs_never_stand_side_by_side(ni, card):
    device = ni(card)
    device.set_output(0.01)
    device.play(np.full(3, 0.01))
    device.set_output(0.02)
    assert device.hold() == pytest.approx(0.02)
    device.start(np.full(3, 0.02))
    with pytest.raises(Refused, match='while a stream is running'):
        device.set_output(0.0)


def test_r14_the_emulator_refuses_them_side_by_side(card):
    from daqmx.virtual_card import CONTINUOUS, DaqmxFault
    for name in ('clocked', 'on demand'):
        card.create_task(name)
        card.add_channels(name, 'Dev1/ao0', -10.0, 10.0, is_output=True)
    card.configure_clock('clocked', 1e5, '/Dev1/ai/SampleClock', CONTINUOUS, 100)
    card.write('clocked', np.full(5, 5.0), 1.0, False)
    card.start('clocked')
    with pytest.raises(DaqmxFault) as caught:
        card.write('on demand', [5.0], 1.0, True)
    assert caught.value.code == -200963
