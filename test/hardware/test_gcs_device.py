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

from piezo_ros.hardware.device import DeviceError, Gone, MissingPackage, RateRefused, Refused
from piezo_ros.hardware.gcs import GcsDevice, GcsParameters
from piezo_ros.hardware.gcs_client import recorded_table
from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

CYCLE_S = 5e-5


@pytest.fixture
def controller():
    from gcs.virtual_controller import VirtualController
    return VirtualController()


@pytest.fixture
def serve():
    import contextlib

    from gcs.virtual_controller import served
    with contextlib.ExitStack() as stack:
        yield lambda controller: stack.enter_context(served(controller))


@pytest.fixture
def make(serve):
    import contextlib
    with contextlib.ExitStack() as stack:
        def device(controller, sample_period_s=CYCLE_S, **parameters):
            made = GcsDevice(GcsParameters(
                address=serve(controller)[1], **{'timeout_s': 3.0, **parameters}))
            stack.callback(made.close)
            if sample_period_s:
                made.open(sample_period_s)
            return made
        yield device


def sine(samples):
    return 1.5 * np.sin(2.0 * np.pi * np.arange(samples) / 200.0)


def test_it_says_what_it_can(make, controller):
    c = make(controller).constraints
    assert (c.highest_rate_hz, c.lowest_rate_hz) == pytest.approx((20e3, 20.0))
    assert c.most_samples == 262_144 // 8 - 65
    assert not c.streams
    assert c.identity == '(c)2026 Emulator, E-727.1CD, 0116021234, 1.2.3.4'


@pytest.mark.parametrize('delay_cycles', [0, 1, 3, 40])
def test_a_block_is_what_the_rig_answers_to_the_printed_decimals(make, controller, delay_cycles):
    controller.faults.delay_cycles = delay_cycles
    device = make(controller)
    readings_um = device.play(sine(300))
    rig = Rig(RigParameters(noise_rms_um=0.0), CYCLE_S, compiled=False)
    wanted_um = [rig.measure(), *rig.run(sine(300))]
    # The noise is that of other instants; the recorder rounds.
    np.testing.assert_allclose(readings_um, wanted_um, atol=6e-3)
    first = delay_cycles
    np.testing.assert_allclose(
        readings_um, controller.rows[first:first + 301, 0] - 6.0, atol=1e-6)


@pytest.mark.parametrize('samples', [1, 2, 3, 101])
@pytest.mark.parametrize('delay_cycles', [0, 5])
def test_r4_a_step_is_answered_at_the_next_reading(make, samples, delay_cycles):
    from gcs.virtual_controller import VirtualController
    # Nearly at once: the step is seen in the reading after it.
    controller = VirtualController(RigParameters(noise_rms_um=0.0))
    controller.faults.delay_cycles = delay_cycles
    device = make(controller)
    for place in {0, samples // 2, samples - 1}:
        device.play(np.zeros(100))
        step_v = np.zeros(samples)
        step_v[place:] = 1.0
        readings_um = device.play(step_v)
        assert readings_um.size == samples + 1
        moved = np.abs(readings_um - readings_um[0]) > 1e-3
        assert moved.any()
        assert np.argmax(moved) == place + 1


def test_a_sample_of_several_cycles(make, controller):
    device = make(controller, 4 * CYCLE_S)
    readings_um = device.play(sine(50))
    rig = Rig(RigParameters(noise_rms_um=0.0), CYCLE_S, compiled=False)
    wanted_um = np.array([rig.measure(), *rig.run(np.repeat(sine(50), 4))])[::4]
    np.testing.assert_allclose(readings_um, wanted_um, atol=6e-3)


def test_blocks_longer_than_a_command_are_uploaded_whole(make, controller):
    make(controller).play(sine(1000))
    np.testing.assert_allclose(
        controller.targets_um[-1][3:1003], 6.0 + 1.2 * sine(1000), atol=1e-12)


def test_r8_r9_nothing_jumps(make):
    from gcs.virtual_controller import VirtualController
    controller = VirtualController(held_um=8.0)
    device = make(controller)
    assert device.hold() == pytest.approx(2.0 / 1.2)
    device.ramp_to(0.0, 100.0)
    assert device.hold() == 0.0
    steps_um = np.abs(np.diff(np.concatenate(controller.targets_um)))
    assert steps_um.max() <= 100.0 * CYCLE_S * 1.2 * (1.0 + 1e-6)


def test_a_ramp_longer_than_a_table_is_made_of_several(make, controller, monkeypatch):
    import dataclasses
    device = make(controller)
    device.constraints = dataclasses.replace(device.constraints, most_samples=100)
    device.ramp_to(1.3, 100.0)
    assert device.hold() == pytest.approx(1.3)
    assert len(controller.targets_um) == 4
    steps_um = np.abs(np.diff(np.concatenate(controller.targets_um)))
    assert steps_um.max() <= 100.0 * CYCLE_S * 1.2 * (1.0 + 1e-6)


def test_software_timed(make, controller):
    device = make(controller)
    device.set_output(0.5)
    assert device.hold() == pytest.approx(0.5)
    for _ in range(200):
        device.set_output(0.5)
    assert device.reading() == pytest.approx(controller.position_um() - 6.0)
    assert device.reading() > 0.1


def test_r15_the_emulator_refuses_another_generator_than_0_and_the_device_does_not_ask(
        make, controller):
    controller.answer('WTR 1 1 0')
    assert controller.answer('ERR?') == '17\n'
    controller.answer('WTR 0 1 0')
    assert controller.answer('ERR?') == '0\n'
    assert make(controller).play(sine(5)).size == 6


def test_points_that_did_not_go_out_are_found(make, controller):
    device = make(controller)
    controller.faults.lost_points = 7
    with pytest.raises(DeviceError, match='the recorded voltage is not the wave'):
        device.play(sine(300))


def test_a_servo_that_is_on_is_refused(make, controller):
    controller.servo_on = True
    device = make(controller, None)
    with pytest.raises(Refused, match='the servo of axis 1 is on'):
        device.open(CYCLE_S)
    controller.servo_on = False
    device.open(CYCLE_S)
    controller.servo_on = True
    with pytest.raises(Refused, match=r"'WGO 1 1' is refused with error 5, unallowable move"):
        device.play(sine(5))


@pytest.mark.parametrize(('period_s', 'told'), [
    (3.3e-5, 'allowed is 5e-05|nearest'), (1.26e-4, 'nearest that its clock makes is'),
    (1.0, 'allowed is 5e-05 … 0.05 s')])
def test_r7_a_period_of_no_whole_cycles_is_refused(make, controller, period_s, told):
    with pytest.raises(RateRefused, match=told):
        make(controller, period_s)


def test_an_axis_that_there_is_not_is_refused(make, controller):
    with pytest.raises(Refused, match="axis is '7', the controller has 1, 2, 3"):
        make(controller, axis='7')


def test_streams_and_long_blocks_are_refused(make, controller):
    device = make(controller)
    for call in (lambda: device.start([0.0]), lambda: device.write([0.0]), lambda: device.read(1),
                 device.generated, device.finish):
        with pytest.raises(Refused, match='there is no stream'):
            call()
    with pytest.raises(Refused, match='a block of 40000 voltages; allowed are 1 … 32703'):
        device.play(np.zeros(40_000))


@pytest.mark.parametrize('value', [np.nan, np.inf, 5.1])
def test_a_voltage_that_is_not_allowed_moves_nothing(make, controller, value):
    device = make(controller)
    for call in (lambda: device.play([0.0, value]), lambda: device.set_output(value),
                 lambda: device.ramp_to(value, 1.0)):
        with pytest.raises(Refused, match='allowed is -7 … 5 V'):
            call()
    assert len(controller.targets_um) == 1


def test_a_controller_that_falls_silent_is_gone(make, controller):
    device = make(controller, timeout_s=0.2)
    controller.faults.silent = True
    with pytest.raises(Gone, match=r'controller at 127.0.0.1:\d+: no reply to .POS. 1. in time'):
        device.reading()
    controller.faults.silent = False
    with pytest.raises(Gone, match='the connection is lost'):
        device.reading()
    device.close()
    device.open(CYCLE_S)
    assert device.hold() == 0.0


def test_a_connection_that_is_cut_is_gone(serve, controller):
    server, address = serve(controller)
    device = GcsDevice(GcsParameters(address=address, timeout_s=3.0))
    device.open(CYCLE_S)
    import socket
    for connection in server.connections:
        connection.shutdown(socket.SHUT_RDWR)
    with pytest.raises(Gone, match='is it still on'):
        device.reading()
    device.close()


def test_where_nothing_listens_it_is_told():
    with pytest.raises(Gone, match='controller at 127.0.0.1:1: no connection'):
        GcsDevice(GcsParameters(address='127.0.0.1:1'))


@pytest.mark.parametrize('address', ['', 'host', 'host:', 'host:x', 'host:99999'])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(ParameterError, match='it must be host:port or a serial port'):
        GcsParameters(address=address)


def test_a_serial_port_needs_its_extra(monkeypatch):
    import sys
    monkeypatch.setitem(sys.modules, 'serial', None)
    with pytest.raises(MissingPackage, match=r"pip install 'piezo_ros\[gcs\]'"):
        GcsDevice(GcsParameters(address='/dev/ttyUSB0'))


@pytest.mark.parametrize('reply', [
    '', '# DIM = 2\n# NDATA = 2\n# END_HEADER\n1 2', '# DIM = 2\n# NDATA = 1\n# END_HEADER\n1 nan',
    '# DIM = 2\n# NDATA = 1\n# END_HEADER\n1 2 3', '# DIM = 2\n# NDATA = 1\n1 2'])
def test_a_table_that_is_cut_off_is_refused(reply):
    with pytest.raises(DeviceError, match='table of the data recorder'):
        recorded_table(reply)
