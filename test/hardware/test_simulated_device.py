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

import numpy as np
import pytest

from piezo_ros.hardware.device import (
    DeviceError,
    Overflow,
    RateRefused,
    Refused,
    Underflow,
)
from piezo_ros.hardware.opening import device_parameters, open_device
from piezo_ros.hardware.simulated import SimulatedDevice, SimulatedDeviceParameters
from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.simulated_rig import Rig


@pytest.fixture
def make():
    def device(sample_period_s=1e-5, **parameters):
        made = SimulatedDevice(SimulatedDeviceParameters(**parameters), compiled=False)
        made.open(sample_period_s)
        return made

    return device


def sine(samples):
    return 1.5 * np.sin(2.0 * np.pi * np.arange(samples) / 200.0)


def rig_readings(voltage_v):
    rig = Rig(compiled=False)
    first_um = rig.measure()
    return [first_um, *rig.run(voltage_v).tolist()]


def test_a_block_has_the_bits_of_the_rig(make):
    voltage_v = sine(300)
    device = make()
    assert [*device.play(voltage_v)] == rig_readings(voltage_v)
    assert device.hold() == voltage_v[-1]


def test_blocks_one_after_the_other_are_one_run_of_the_rig(make):
    voltage_v = sine(300)
    device = make()
    one, other = device.play(voltage_v[:100]), device.play(voltage_v[100:])
    assert other[0] == one[-1]
    assert [*one, *other[1:]] == rig_readings(voltage_v)


@pytest.mark.parametrize('sizes', [(1, 1, 1), (7, 50, 3), (100, 1, 200)])
def test_a_stream_has_the_bits_of_the_rig_whatever_its_blocks(make, sizes):
    prefill, written, read = sizes
    voltage_v = sine(201)
    device = make()
    device.start(voltage_v[:prefill])
    readings_um = []
    for first in range(prefill, 201, written):
        device.write(voltage_v[first:first + written])
        # As much as is certainly there.
        readings_um += [*device.read(min(read, first + 1 - len(readings_um)))]
    device.finish()
    readings_um += [*device.read(202 - len(readings_um))]
    assert readings_um == rig_readings(voltage_v)
    with pytest.raises(Refused, match='no stream is running'):
        device.read(1)


def test_software_timed_samples_have_the_bits_of_the_rig(make):
    device = make()
    readings_um = [device.reading()]
    for voltage_v in sine(50):
        device.set_output(voltage_v)
        readings_um.append(device.reading())
    assert readings_um == rig_readings(sine(50))


def test_a_stream_that_starves_names_the_first_sample_that_is_missing(make):
    device = make()
    device.start(sine(10))
    assert device.read(11).size == 11
    assert device.generated() == 10
    with pytest.raises(Underflow, match='ran out of samples at index 10') as caught:
        device.read(1)
    assert caught.value.index == 10
    # Too late: the output stands still.
    with pytest.raises(Underflow):
        device.write([0.0])
    device.ramp_to(0.0, 100.0)
    assert device.hold() == 0.0


def test_readings_before_an_underflow_can_still_be_fetched(make):
    device = make()
    device.start(sine(10))
    with pytest.raises(Underflow):
        device.read(12)
    assert [*device.read(11)] == rig_readings(sine(10))


def test_a_full_buffer_lets_time_go_on_and_readings_that_do_not_fit_are_an_overflow(make):
    device = make(buffer_samples=8)
    device.start(np.zeros(8))
    device.write(np.zeros(5))
    assert device.generated() == 6
    with pytest.raises(Overflow, match='9 readings wait, its buffer keeps 8'):
        device.write(np.zeros(3))
    with pytest.raises(Refused, match='9 voltages at once; its buffer takes 1 … 8'):
        make(buffer_samples=8).start(np.zeros(9))


def test_a_ramp_begins_where_the_output_is(make):
    device = make(held_v=2.0)
    assert device.hold() == 2.0
    device.ramp_to(0.0, 100.0)
    assert device.hold() == 0.0
    assert device.rig.saturated_samples == (0, 0)


def test_a_ramp_ends_a_stream(make):
    device = make()
    device.start(sine(40))
    device.read(31)
    assert device.hold() == sine(40)[30]
    assert device.generated() == 31
    device.ramp_to(0.0, 100.0)
    assert device.hold() == 0.0
    with pytest.raises(Refused, match='no stream'):
        device.write([0.0])


def test_a_closed_device_holds_and_can_be_opened_again(make):
    device = make()
    device.play(sine(30))
    device.close()
    device.close()
    with pytest.raises(DeviceError, match='not open'):
        device.reading()
    device.open(1e-5)
    assert device.hold() == sine(30)[-1]


@pytest.mark.parametrize(('voltage_v', 'told'), [
    ([0.0, np.nan], r'voltage_v[1] is nan V, allowed is -7 … 5 V'),
    ([0.0, 0.0, 5.1], r'voltage_v[2] is 5.1 V, allowed is -7 … 5 V'),
    ([-np.inf], r'voltage_v[0] is -inf V'),
    ([], r'shape (0,)'),
    ([[0.0]], r'shape (1, 1)'),
])
def test_a_voltage_that_is_not_allowed_is_named_before_anything_moves(make, voltage_v, told):
    device = make()
    with pytest.raises(Refused) as caught:
        device.play(voltage_v)
    assert told in str(caught.value)
    with pytest.raises(Refused):
        device.start(voltage_v)
    assert device.hold() == 0.0
    assert device.rig.index == 0


def test_too_large_a_block_is_refused(make):
    with pytest.raises(Refused, match='a block of 11 voltages; allowed are 1 … 10'):
        make(most_samples=10).play(np.zeros(11))


@pytest.mark.parametrize('call', [
    lambda device: device.play([0.0]), lambda device: device.start([0.0]),
    lambda device: device.set_output(0.0)])
def test_nothing_else_is_done_while_a_stream_runs(make, call):
    device = make()
    device.start([0.0])
    with pytest.raises(Refused, match='while a stream is running'):
        call(device)


@pytest.mark.parametrize('sample_period_s', [1e-9, 1e4])
def test_a_rate_beyond_the_range_is_refused(sample_period_s):
    with pytest.raises(RateRefused, match='sample_period_s is'):
        SimulatedDevice(compiled=False).open(sample_period_s)


@pytest.mark.parametrize('sample_period_s', [0.0, -1e-5, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(sample_period_s):
    with pytest.raises(Refused, match='sample_period_s'):
        SimulatedDevice(compiled=False).open(sample_period_s)


def test_open_device_makes_the_kind_that_is_named():
    device = open_device('simulated', {'seed': 3, 'buffer_samples': 100})
    assert device.constraints.buffer_samples == 100
    assert device.constraints.identity == 'simulated stage, seed 3'
    assert 'noise_rms_um' in device_parameters('simulated').names()


@pytest.mark.parametrize(('kind', 'parameters', 'told'), [
    ('analogue', {}, "device is 'analogue', allowed are simulated"),
    ('simulated', {'sed': 3}, "unknown parameter 'sed'"),
    ('simulated', {'seed': -1}, 'seed is -1, allowed is 0'),
])
def test_open_device_names_what_it_cannot_take(kind, parameters, told):
    with pytest.raises(ParameterError, match=told):
        open_device(kind, parameters)


def test_to_read_all_there_is_runs_dry_unless_the_stream_is_finished(make):
    device = make()
    device.start(sine(10))
    device.read(11)
    with pytest.raises(Underflow, match='at index 10'):
        device.write([0.0])
    device.finish()
    assert device.play([0.0]).size == 2
