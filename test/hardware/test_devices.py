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

"""The NI device by both ways: like the simulated one, and what becomes of faults and limits."""

import importlib
import sys

import numpy as np
import pytest

from piezo_ros.hardware.device import (
    DeviceError,
    Gone,
    MissingPackage,
    Overflow,
    RateRefused,
    Refused,
    Underflow,
)
from piezo_ros.hardware.opening import DEVICE_KINDS, device_parameters, open_device
from piezo_ros.hardware.simulated import SimulatedDevice
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

SLEW_V_PER_S = 1000.0


def sine(samples):
    return 1.5 * np.sin(2.0 * np.pi * np.arange(samples) / 200.0)


def driven(device):
    """Drive a device through all that it can do; return every reading and voltage held."""
    told = [device.hold(), device.reading()]
    told += [*device.play(sine(150))]
    told += [*device.play([sine(150)[-1]]), device.hold()]
    device.ramp_to(-0.5, SLEW_V_PER_S)
    told += [device.hold(), device.reading()]
    device.start(np.full(40, -0.5))
    told += [*device.read(30)]
    device.write(-0.5 + 0.1 * sine(60))
    told += [*device.read(50), device.generated()]
    device.finish()
    told += [*device.read(21), device.hold()]
    for voltage_v in (0.1, 0.2, 0.3):
        device.set_output(voltage_v)
        told += [device.reading(), device.hold()]
    device.start(0.3 + sine(50))
    device.read(31)
    told += [device.hold(), device.generated()]
    device.ramp_to(0.0, SLEW_V_PER_S)
    told += [device.hold()]
    device.close()
    device.open(1e-5)
    return [*told, device.hold()]


def test_a_card_tells_what_the_simulated_device_tells(ni, make_card):
    reference = SimulatedDevice(compiled=False)
    reference.open(1e-5)
    card = make_card()
    told = driven(ni(card))
    wanted = driven(reference)
    np.testing.assert_allclose(told, wanted, rtol=0.0, atol=1e-12)


def test_the_constraints_are_those_of_the_card(ni, card):
    c = ni(card).constraints
    assert (c.lowest_rate_hz, c.highest_rate_hz) == (0.006, 625e3)
    assert (c.lowest_voltage_v, c.highest_voltage_v) == (-7.0, 5.0)
    assert c.identity == 'PCI-6289, serial number 17C0FFEE'
    assert c.streams


def test_the_cards_that_are_attached_are_listed(card, serve):
    from piezo_ros.hardware.ni import attached_cards
    assert attached_cards(serve(card)[1]) == ['Dev1: PCI-6289, serial number 17C0FFEE']


@pytest.mark.parametrize('value', [np.nan, np.inf, 5.001, -7.001])
def test_a_voltage_that_is_not_allowed_moves_nothing(ni, card, value):
    device = ni(card)
    pieces = len(card.outputs_v)
    for call in (lambda: device.play([0.0, value]), lambda: device.set_output(value),
                 lambda: device.start([value]), lambda: device.ramp_to(value, 1.0)):
        with pytest.raises(Refused, match=r'Dev1.*\[[01]\] is .* V, allowed is -7 … 5 V'):
            call()
    assert len(card.outputs_v) == pieces
    device.start([0.0])
    with pytest.raises(Refused, match='allowed is -7'):
        device.write([value])
    assert {*np.concatenate(card.outputs_v)} == {5.0}


def test_a_card_that_is_unplugged_is_gone_and_then_back(ni, card):
    device = ni(card)
    device.start(sine(100))
    card.faults.gone = True
    for call in (lambda: device.read(10), lambda: device.write([0.0]), device.generated):
        with pytest.raises(Gone, match='Device cannot be accessed'):
            call()
    card.faults.gone = False
    device.ramp_to(0.0, SLEW_V_PER_S)
    assert card.held_v['ao0'] == 5.0


def test_readings_that_were_overwritten_are_an_overflow(ni, card):
    device = ni(card, buffer_samples=1000)
    device.start(sine(900))
    card.faults.ticks_before_read = 1001
    with pytest.raises(Overflow, match='samples were overwritten'):
        device.read(10)
    device.ramp_to(0.0, SLEW_V_PER_S)


def test_more_than_the_buffer_is_written_while_time_goes_on(ni, card):
    device = ni(card, buffer_samples=1000)
    with pytest.raises(Refused, match='prefill of 1001 voltages; buffer_samples allows 1 … 1000'):
        device.start(sine(1001))
    device.start(sine(1000))
    device.write(sine(1500)[1000:])
    assert device.generated() >= 500


def test_a_stream_has_no_more_readings_than_voltages_and_one(ni, card):
    device = ni(card)
    device.start(sine(10))
    device.finish()
    with pytest.raises(Refused, match='takes no more voltages'):
        device.write([0.0])
    with pytest.raises(Refused, match='of 10 voltages 11 readings are left'):
        device.read(12)
    assert device.read(11).size == 11
    assert device.hold() == sine(10)[-1]
    with pytest.raises(Refused, match='no stream is running'):
        device.read(1)


def test_a_sensor_that_is_stuck_shows_what_it_shows(ni, card):
    device = ni(card, sensor_offset_v=0.5)
    card.faults.stuck_v = 2.5
    assert {*device.play(sine(20))} == {2.4}


@pytest.mark.parametrize('sample_period_s', [1e-7, 1e4])
def test_a_rate_beyond_the_card_is_refused(ni, card, sample_period_s):
    with pytest.raises(RateRefused, match='allowed is 1.6e-06 … 166.667 s'):
        ni(card, sample_period_s)


@pytest.mark.parametrize(('parameters', 'told'), [
    ({'input_channel': 'Dev1/ai99'}, 'no such channel'),
    ({'output_channel': 'Dev7/ao0', 'input_channel': 'Dev7/ai0'}, 'no such device'),
])
def test_a_channel_or_card_that_there_is_not_is_refused(ni, card, parameters, told):
    with pytest.raises(Refused, match=told):
        ni(card, **parameters)


def test_a_server_that_is_not_there_is_told(make_card):
    make_card()
    with pytest.raises(Gone, match='Dev1 at 127.0.0.1:1: the device server does not answer'):
        open_device('ni', {'address': '127.0.0.1:1'})


def test_a_server_that_is_lost_is_told(make_card):
    from daqmx.daqmx_service import served
    card = make_card()
    with served(card) as (_, address):
        device = open_device('ni', {'address': address, 'timeout_s': 2.0})
        device.open(1e-5)
        device.start(sine(100))
        device.read(10)
    with pytest.raises(Gone, match='the device server does not answer'):
        device.read(10)
    with pytest.raises(Gone):
        device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    # It holds, and the next start goes on from there.
    assert card.held_v['ao0'] == 5.0 + sine(100)[9]
    with served(card, address) as (_, same):
        assert same == address
        device.open(1e-5)
        device.ramp_to(0.0, SLEW_V_PER_S)
        device.close()
    assert card.held_v['ao0'] == 5.0


def test_without_the_driver_it_is_told(make_card, monkeypatch):
    make_card()
    from nidaqmx import _lib
    monkeypatch.setattr(_lib, 'find_library', lambda name: None)
    with pytest.raises(Gone, match='the NI-DAQmx driver is not installed on this machine'):
        open_device('ni', {})


@pytest.mark.parametrize('kind', DEVICE_KINDS)
def test_everything_is_imported_without_the_libraries_of_the_vendors(kind, monkeypatch):
    for name in ('nidaqmx', 'grpc', 'serial'):
        monkeypatch.setitem(sys.modules, name, None)
    for name in [name for name in sys.modules if name.startswith('piezo_ros.hardware')]:
        monkeypatch.delitem(sys.modules, name)
    module = importlib.import_module('piezo_ros.hardware.opening')
    assert module.device_parameters(kind)().to_mapping()


def test_a_package_that_is_missing_is_one_line_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'nidaqmx', None)
    with pytest.raises(MissingPackage) as caught:
        open_device('ni', {})
    assert "pip install 'piezo_ros[ni]'" in str(caught.value)
    assert '\n' not in str(caught.value)


def test_grpc_that_is_missing_is_told_too(make_card, monkeypatch):
    make_card()
    monkeypatch.setitem(sys.modules, 'grpc', None)
    with pytest.raises(MissingPackage, match=r"grpcio.*pip install 'piezo_ros\[ni\]'"):
        open_device('ni', {'address': '127.0.0.1:1'})


def test_a_device_that_is_not_open_says_so(ni, card):
    device = ni(card, None)
    for call in (device.hold, device.reading, lambda: device.play([0.0])):
        with pytest.raises(DeviceError, match='it is not open'):
            call()


def test_the_parameters_of_every_kind_are_known():
    for kind in DEVICE_KINDS:
        assert device_parameters(kind).names()


@pytest.mark.slow  # By the wall clock.
def test_ten_seconds_at_100_khz_are_streamed_without_a_gap(make_card, serve):
    from daqmx.virtual_card import RigStage
    device, voltage_v = None, sine(1_000_000)
    card = make_card(
        RigStage(RigParameters(), compiled=True), wall_clock_factor=1.0)
    device = open_device('ni', {'address': serve(card)[1]})
    device.open(1e-5)
    device.start(voltage_v[:100_000])
    readings_um = []
    for first in range(100_000, 1_000_000, 5000):
        device.write(voltage_v[first:first + 5000])
        readings_um.append(device.read(5000))
    device.finish()
    readings_um.append(device.read(100_001))
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    rig = Rig(RigParameters())
    np.testing.assert_array_equal(
        np.concatenate(readings_um), [rig.measure(), *rig.run((voltage_v + 5.0) - 5.0)])


@pytest.mark.slow  # By the wall clock.
def test_by_the_wall_clock_a_writer_that_stops_is_an_underflow(make_card, serve):
    card = make_card(wall_clock_factor=1.0)
    device = open_device('ni', {'address': serve(card)[1]})
    device.open(1e-3)
    device.start(sine(100))

    def starve():
        for _ in range(100):
            device.read(10)

    with pytest.raises(Underflow) as caught:
        starve()
    assert caught.value.index == 100
    device.ramp_to(0.0, SLEW_V_PER_S)
    device.close()
    assert card.held_v['ao0'] == 5.0
