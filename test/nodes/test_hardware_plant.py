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

"""The hardware plant on topics in memory: bits, refusals, faults, and where the output ends."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from fake_node import activate, configure, fake_node, look_after, poll_all
from fake_transport import PERIOD_S, FakeTransport, take_all
from paced_device import PacedDevice
from rclpy.lifecycle import TransitionCallbackReturn

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.nodes.compensator import Compensator
from piezo_ros.nodes.controller import Controller
from piezo_ros.nodes.hardware_plant import HardwarePlant
from piezo_ros.nodes.trajectory import Trajectory
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError

SLEW_V_PER_S = 1000.0
PACED = 'paced_device:PacedDevice'
# Slow enough for a clock in Python, and for no step of the run to be above the safe slew.
GENTLE = {'sample_period_s': 1e-3, 'frequency_hz': 5.0, 'waveform': 'sine', 'harmonics': 1}


class Ring:
    """The loop with a hardware plant."""

    def __init__(self, *, scheme='ff', lookahead_samples=1000, trajectory=None, law=None, **plant):
        transport = self.transport = FakeTransport()
        trajectory = {'periods': 3.0, **(trajectory or {})}
        self.period_s = trajectory.get('sample_period_s', PERIOD_S)
        common = {'sample_period_s': self.period_s}
        self.law = {'scheme': scheme, **(law or {})}
        self.trajectory = trajectory
        self.plant = fake_node(
            HardwarePlant, transport, **{'demagnetise': False, **common, **plant})
        self.nodes = [
            fake_node(Compensator, transport, **common),
            fake_node(Controller, transport, lookahead_samples=lookahead_samples,
                      **self.law, **common),
            self.plant, fake_node(Trajectory, transport, **trajectory)]
        self.reader = transport.reader('displacement')
        configure(*self.nodes)

    def begin(self):
        self.reader.start(0, self.period_s)
        activate(*self.nodes)
        return self

    def run(self):
        self.begin()
        for _ in range(100_000):
            step(self.nodes)
            if not self.plant.running:
                break
        poll_all(*self.nodes)
        return take_all(self.reader)

    def expected(self):
        return simulate(
            RigParameters(), HysteresisParameters(), ControllerParameters(**self.law),
            TrajectoryParameters(**self.trajectory)).displacement_um.tolist()


@pytest.mark.parametrize(('plant', 'lookahead_samples', 'mode'), [
    ({}, 2000, 'whole run prefilled'),
    ({'prefill_samples': 50, 'read_samples': 20}, 200, 'streamed'),
    ({'prefill_samples': 1, 'read_samples': 1}, 5, 'streamed'),
])
def test_it_gives_the_bits_of_the_simulated_plant(plant, lookahead_samples, mode):
    ring = Ring(lookahead_samples=lookahead_samples, **plant)
    assert ring.run() == ring.expected()
    assert [node.run_state.result for node in ring.nodes] == ['finished'] * 4
    status = ring.plant.status_fields()
    assert status['played'] == mode
    assert (status['voltage_after_v'], status['opening_difference_um']) == (0.0, 0.0)
    assert 'seed 1' in status['device']
    assert status['device_rate_hz'] == 1e5


@pytest.mark.parametrize('scheme', ['ff', 'open_loop'])
def test_a_second_run_is_whole_too(scheme):
    ring = Ring(scheme=scheme, lookahead_samples=2000)
    first = ring.run()
    for node in ring.nodes:
        node.on_deactivate(None)
    second = ring.run()
    assert first == second == ring.expected()  # the simulated device makes a new stage


def test_feedback_on_demand_gives_the_bits_of_the_loop_and_its_jitter():
    ring = Ring(scheme='fbff', timing='on_demand', trajectory={**GENTLE, 'periods': 0.25},
                law={'proportional_gain': 0.01, 'integral_gain_per_s': 50.0})
    assert ring.run() == ring.expected()
    status = ring.plant.status_fields()
    assert status['played'] == 'on demand'
    assert 0.0 < status['jitter_mean_s'] <= status['jitter_rms_s'] <= status['jitter_max_s']


@pytest.mark.parametrize('scheme', ['fb', 'fbff'])
def test_feedback_is_refused_by_name_before_anything_moves(scheme):
    ring = Ring(scheme=scheme)
    ring.reader.start(0, ring.period_s)
    results = [node.on_activate(None) for node in ring.nodes]
    assert results[2] == TransitionCallbackReturn.FAILURE
    assert f'scheme {scheme}' in ring.plant.run_state.reason
    assert take_all(ring.reader) == []


@pytest.mark.parametrize(('parameters', 'words'), [
    ({'safe_slew_v_per_s': 1.0}, ('safe_slew_v_per_s is 1', '3 … inf')),
    ({'safe_slew_v_per_s': 500.0, 'slew_limit_v_per_s': 400.0}, ('500', '3 … 400')),
    ({'timing': 'on_demand'}, ('sample_period_s is 1e-05', '0.001')),
    ({'initialise_amplitude_v': 6.0}, ('initialise_amplitude_v is 6', '0 … 5')),
    ({'device': 'nonsense'}, ("'nonsense'", 'simulated, ni, gcs')),
])
def test_what_does_not_go_together_is_refused_as_it_is_configured(parameters, words):
    plant = fake_node(HardwarePlant, FakeTransport(), **parameters)
    assert plant.on_configure(None) == TransitionCallbackReturn.FAILURE
    assert all(word in plant.run_state.reason for word in words), plant.run_state.reason


@pytest.mark.parametrize(('device', 'words'), [
    ('no_such_module:Device', 'no_such_module'), ('json:NoSuchClass', 'NoSuchClass')])
def test_a_device_that_is_not_there_is_refused_by_name(device, words):
    ring = Ring(device=device)
    assert ring.plant.on_activate(None) == TransitionCallbackReturn.FAILURE
    assert words in ring.plant.run_state.reason


@pytest.mark.parametrize(('limits', 'words'), [
    ({'slew_limit_v_per_s': 2000.0}, 'sample 0: slew is '),
    ({'load_capacitance_f': 2.6e-6}, 'sample 0: peak current is '),
    ({'voltage_maximum_v': 5.5}, 'amplifier input is '),
    ({'gain_um_per_v': 20.0}, 'displacement is '),
])
def test_a_run_beyond_a_limit_is_refused_before_it_moves(limits, words):
    ring = Ring(lookahead_samples=2000, device=PACED, **limits)
    assert len(ring.run()) == 1
    assert ring.plant.run_state.result == 'faulted'
    assert words in ring.plant.run_state.fault
    assert not PacedDevice.devices[-1].output.any()
    assert PacedDevice.devices[-1].is_closed


def test_it_begins_softly_from_what_the_output_holds():
    ring = Ring(lookahead_samples=2000, device=PACED, output_channel='held 3.0',
                trajectory={**GENTLE, 'periods': 0.2})
    ring.run()
    assert ring.plant.run_state.result == 'finished', ring.plant.run_state.fault
    assert ring.plant.status_fields()['voltage_before_v'] == 3.0
    assert_safe(PacedDevice.devices[-1])


def test_it_demagnetises_first():
    ring = Ring(lookahead_samples=2000, device=PACED, demagnetise=True, initialise_levels=3,
                trajectory={**GENTLE, 'periods': 0.2})
    ring.run()
    output_v = PacedDevice.devices[-1].output
    turns = np.flatnonzero(np.diff(np.sign(np.diff(output_v))) != 0)
    assert output_v.max() == pytest.approx(5.0)
    assert turns.size >= 6
    assert_safe(PacedDevice.devices[-1])


@pytest.mark.parametrize('demagnetise', [True, False])
def test_a_sensor_that_does_not_follow_the_voltage_ends_the_run(demagnetise):
    ring = Ring(lookahead_samples=2000, device=PACED, output_channel='stuck 0.25',
                demagnetise=demagnetise, initialise_levels=3,
                trajectory={**GENTLE, 'periods': 2.0})
    readings_um = ring.run()
    assert len(readings_um) < 400
    fault = ring.plant.run_state.fault
    assert 'the sensor shows 0.25 um in 2' in fault
    assert 'stuck, off or not connected' in fault
    assert_safe(PacedDevice.devices[-1])


def last_reading(value):
    def change(readings_um):
        changed_um = np.array(readings_um)
        changed_um[-1] = value
        return changed_um

    return change


WRONG_READINGS = [
    (last_reading(np.nan), 'gave nan um as its reading at index 23'),
    (last_reading(-np.inf), 'gave -inf um as its reading at index 23'),
    (lambda readings_um: readings_um[:-1], 'shape (3,) where it was asked for 4 from index 20'),
    (lambda readings_um: [*readings_um, 0.1], 'shape (5,) where it was asked for 4 from index 20'),
]


def disturb(monkeypatch, method, call, change):
    """Have a paced device give something else at a call of a method, the first being 1."""
    def give(device, *arguments):
        given.append(right(device, *arguments))
        return change(given[-1]) if len(given) == call else given[-1]

    given, right = [], getattr(PacedDevice, method)
    monkeypatch.setattr(PacedDevice, method, give)


@pytest.mark.parametrize(('change', 'words'), WRONG_READINGS)
def test_a_reading_that_is_none_ends_the_run_with_its_index(change, words, monkeypatch):
    disturb(monkeypatch, 'read', 6, change)
    ring = Ring(device=PACED, read_samples=4, lookahead_samples=2000,
                trajectory={**GENTLE, 'periods': 1.0})
    assert len(ring.run()) == 20
    assert words in ring.plant.run_state.fault
    assert 'Traceback' not in ''.join(ring.plant.logger.texts['error'])
    assert_safe(PacedDevice.devices[-1])


@pytest.mark.parametrize(('method', 'call', 'change', 'words', 'plant'), [
    ('reading', 1, lambda _: np.nan, 'nan um as its reading at index 0', {}),
    ('reading', 4, lambda _: np.inf, 'inf um as its reading at index 3', {'timing': 'on_demand'}),
    ('play', 2, last_reading(np.nan), 'nan um as its reading at index 400',
     {'demagnetise': True, 'safe_slew_v_per_s': 100.0}),
])
def test_so_does_one_however_it_is_taken(method, call, change, words, plant, monkeypatch):
    disturb(monkeypatch, method, call, change)
    ring = Ring(device=PACED, lookahead_samples=2000, trajectory={**GENTLE, 'periods': 0.2},
                **plant)
    ring.run()
    assert words in ring.plant.run_state.fault
    assert_safe(PacedDevice.devices[-1], plant.get('safe_slew_v_per_s', SLEW_V_PER_S))


def test_so_does_one_of_a_block(monkeypatch):
    disturb(monkeypatch, 'play', 1, last_reading(np.nan))
    ring = Ring(device=PACED, lookahead_samples=2000, trajectory={**GENTLE, 'periods': 0.2}).begin()
    device = PacedDevice.devices[-1]
    device.constraints = replace(device.constraints, streams=False)
    while ring.plant.running:
        step(ring.nodes)
    assert f'nan um as its reading at index {device.output.size - 2}' in ring.plant.run_state.fault
    assert_safe(device)


def test_a_starved_stream_is_a_fault_with_its_index_and_ends_at_rest():
    ring = Ring(device=PACED, prefill_samples=20, read_samples=5, lookahead_samples=60,
                trajectory={**GENTLE, 'periods': 5.0})
    ring.begin()
    while ring.plant.running:
        is_starved = ring.plant.writers['displacement'].sent > 40
        step([ring.plant] if is_starved else ring.nodes)
    assert 'ran out of samples at index' in ring.plant.run_state.fault
    assert_safe(PacedDevice.devices[-1])


def test_a_reader_that_does_not_take_keeps_no_voltage_standing(clock, monkeypatch):
    ring = Ring(prefill_samples=50, read_samples=20, lookahead_samples=200, watchdog_s=2.0)
    ring.begin()
    writer = ring.plant.writers['displacement']
    publish_raw = writer.outlet.publish_raw

    def wait_and_publish(raw):
        if writer.publisher.refusals:
            clock.advance(0.1)
        if not ring.plant.running:
            held_v.append(ring.plant.status_fields()['voltage_v'])
        publish_raw(raw)

    held_v = []
    monkeypatch.setattr(writer.outlet, 'publish_raw', wait_and_publish)
    while writer.sent < 200:
        step(ring.nodes)
    assert ring.plant.status_fields()['voltage_v'] != 0.0
    writer.publisher.refusals = 100  # 10 s, of which the end waits for the most
    while ring.plant.running:
        step(ring.nodes)
    assert 'has waited at sample' in ring.plant.run_state.fault
    assert len(held_v) > 50
    assert set(held_v) == {0.0}
    assert len(take_all(ring.reader)) == writer.sent
    assert ring.reader.ended


def test_a_device_that_is_gone_is_named_and_its_voltage_is_not_known():
    ring = Ring(device=PACED, output_channel='gone 3', read_samples=2, lookahead_samples=2000,
                trajectory={**GENTLE, 'periods': 0.2})
    ring.begin()
    for _ in range(10_000):
        step(ring.nodes)
    assert 'does not answer' in ring.plant.run_state.fault
    assert ring.plant.status_fields()['voltage_v'] is None


@pytest.mark.parametrize('lost_at', [1, 3])
def test_a_device_that_holds_no_number_is_refused_and_its_voltage_is_not_known(
        monkeypatch, lost_at):
    def hold(device):
        calls.append(device)
        return held(device) if len(calls) < lost_at else math.nan

    calls, held = [], PacedDevice.hold
    monkeypatch.setattr(PacedDevice, 'hold', hold)
    plant = fake_node(
        HardwarePlant, FakeTransport(), device=PACED, sample_period_s=1e-3,
        safe_slew_v_per_s=10.0, output_channel='held 1.0')
    configure(plant)
    with pytest.raises(ServiceRefusedError, match='holds nan V: the voltage is not known'):
        plant.initialise()
    assert plant.status_fields()['voltage_v'] is None
    assert PacedDevice.devices[-1].is_closed


def test_a_stop_while_it_initialises_ends_at_rest(monkeypatch):
    plant = fake_node(
        HardwarePlant, FakeTransport(), device=PACED, sample_period_s=1e-3,
        safe_slew_v_per_s=10.0, output_channel='held 1.0')
    configure(plant)
    chunks = []

    def play(device, voltage_v):
        chunks.append(voltage_v)
        plant.stop_requested = len(chunks) == 2  # as a signal does
        return played(device, voltage_v)

    played = PacedDevice.play
    monkeypatch.setattr(PacedDevice, 'play', play)
    with pytest.raises(ServiceRefusedError, match='stopped within the triangle'):
        plant.initialise()
    assert len(chunks) == 2
    assert chunks[-1][-1] > 1.0
    assert plant.status_fields()['voltage_v'] == 0.0
    assert_safe(PacedDevice.devices[-1], 10.0)


@pytest.mark.parametrize('start_index', [0, -1])
def test_a_writer_may_leave_while_the_stage_is_demagnetised(start_index, clock):
    ring = Ring(scheme='open_loop', lookahead_samples=2000, device=PACED, demagnetise=True,
                initialise_levels=3, start_index=start_index, lost_writer_timeout_s=0.5,
                trajectory={**GENTLE, 'periods': 0.2}).begin()
    poll_all(*[node for node in ring.nodes if node is not ring.plant])
    step([ring.plant])  # at rest; the triangle is next
    for publisher in list(ring.transport.publishers['/rig/voltage']):
        publisher.destroy()
    clock.run(2.0, lambda: look_after(ring.plant, clock.now_s))
    assert take_all(ring.reader) == []
    while ring.plant.running:
        step([ring.plant])
    assert ring.plant.run_state.result == 'finished', ring.plant.run_state.fault
    assert len(take_all(ring.reader)) == 41
    assert PacedDevice.devices[-1].output.max() == pytest.approx(5.0)
    assert_safe(PacedDevice.devices[-1])


@pytest.mark.parametrize('error', [RuntimeError('made up'), OSError('made up')])
def test_a_voltage_is_not_known_after_a_ramp_that_fails(error, monkeypatch):
    def ramp_to(device, voltage_v, slew_v_per_s):
        raise error

    ring = Ring(device=PACED, read_samples=2, lookahead_samples=2000,
                trajectory={**GENTLE, 'periods': 5.0}).begin()
    monkeypatch.setattr(PacedDevice, 'ramp_to', ramp_to)
    while not ring.plant.status_fields()['voltage_v']:
        step(ring.nodes)
    ring.plant.stop('SIGINT')
    assert 'made up' in ring.plant.run_state.fault
    assert ring.plant.status_fields()['voltage_v'] is None
    assert ring.plant.status_fields()['voltage_after_v'] is None
    assert PacedDevice.devices[-1].is_closed


@pytest.mark.parametrize('error', [RuntimeError('made up'), OSError('made up')])
@pytest.mark.parametrize('method', ['open', 'hold'])
def test_a_device_that_cannot_be_opened_is_closed(method, error, monkeypatch):
    def fail(device, *arguments):
        raise error

    ring = Ring(device=PACED)
    monkeypatch.setattr(PacedDevice, method, fail)
    assert ring.plant.on_activate(None) == TransitionCallbackReturn.FAILURE
    assert 'made up' in ring.plant.run_state.reason
    assert PacedDevice.devices[-1].is_closed


def test_a_lookahead_that_is_too_short_is_named(clock):
    ring = Ring(lookahead_samples=100)
    ring.begin()
    poll_all(*ring.nodes)
    clock.run(5.0, lambda: look_after(ring.plant, clock.now_s))
    assert 'lookahead_samples' in ring.plant.run_state.fault
    assert '100 voltages wait' in ring.plant.run_state.fault


def step(nodes):
    """Let each node do what it can once, as the stream loop does."""
    for node in nodes:
        if node.running:
            try:
                node.quick(1)
            except Exception as error:
                node.run.break_off(error)


def assert_safe(device, slew_v_per_s=SLEW_V_PER_S):
    steps_v = np.abs(np.diff(device.output))
    assert steps_v.max() <= slew_v_per_s * device._period_s * (1.0 + 1e-9)
    assert device.output[-1] == 0.0
    assert device.is_closed


def interrupted(kind, turns, **plant):
    """Run until so many turns of the loop, interrupt, and return the device."""
    ring = Ring(device=PACED, lookahead_samples=400, read_samples=5, output_channel='held -2.0',
                trajectory={**GENTLE, 'periods': 1.0, 'amplitude_um': 4.0}, **plant).begin()
    for _ in range(turns):
        step(ring.nodes)
    if kind == 'stop':
        ring.plant.stop('SIGINT')
    elif kind == 'exception':
        if ring.plant.running:
            ring.plant.run.break_off(RuntimeError('made up'))
    elif kind == 'peer stops':
        random.choice([ring.nodes[0], ring.nodes[1], ring.nodes[3]]).stop('SIGTERM')
    else:  # a peer is killed: its writer goes, or stays and says nothing
        ring.nodes[0].running = False
        if kind == 'lost writer':
            for publisher in list(ring.transport.publishers['/rig/voltage']):
                publisher.destroy()
        ring.plant.parameters_changed()
    for _ in range(100_000):
        step(ring.nodes)
        look_after(ring.plant, ring.plant.run._next_check_s + 1.0)
        if not ring.plant.running or (
                kind == 'silent writer' and not ring.plant.readers['voltage'].received):
            break
    if ring.plant.running:
        # A writer that has said nothing yet keeps the plant waiting, at rest.
        ring.plant.stop('SIGINT')
    return PacedDevice.devices[-1]


KINDS = ['stop', 'exception', 'peer stops', 'lost writer', 'silent writer']


@pytest.mark.parametrize('kind', KINDS)
def test_an_interrupted_run_ends_at_rest_without_a_step(kind):
    device = interrupted(kind, 30, prefill_samples=20, watchdog_s=0.1)
    assert device.output.max() > 0.2  # it held -2 V at first
    assert_safe(device)


@pytest.mark.parametrize('kind', ['stop', 'lost writer', 'silent writer'])
def test_so_does_one_that_software_times(kind):
    device = interrupted(kind, 400, timing='on_demand', watchdog_s=0.1)
    assert device.output.max() > 0.2
    assert_safe(device)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(200))
def test_r8_random_interruptions_end_at_rest_without_a_step(seed):
    random.seed(seed)
    prefill_samples = random.choice([0, 1, 20, 100])
    assert_safe(interrupted(
        random.choice(KINDS), random.randrange(150), prefill_samples=prefill_samples,
        watchdog_s=0.1, demagnetise=random.random() < 0.2, initialise_levels=1))
