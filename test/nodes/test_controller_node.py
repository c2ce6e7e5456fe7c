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

"""The controller between foreign nodes: changes during a run, and joining one."""

import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from piezo_ros.control import ControllerParameters
from piezo_ros.control.controller_step import (
    controller_constants,
    controller_step,
    initial_state,
    prepare_transfer,
)

PERIOD_S = 1e-5
STREAMS = ('reference', 'feedforward', 'displacement')
SAMPLES = np.random.default_rng(1).normal(size=(3, 300))


def commands(*pieces, delay=1):
    """Return the commands under some laws, each from a sample on."""
    starts, laws = [start for start, _ in pieces], [law for _, law in pieces]
    state = initial_state(ControllerParameters(measurement_delay_samples=delay))
    result = []
    for k, (reference_um, feedforward_um, displacement_um) in enumerate(SAMPLES.T.tolist()):
        number = sum(start <= k for start in starts) - 1
        if k in starts[1:]:
            prepare_transfer(state)
        result.append(controller_step(
            state, controller_constants(laws[number], PERIOD_S), k, reference_um, feedforward_um,
            displacement_um))
    return result


@pytest.fixture
def controller(rig, peer):
    """Start a controller between foreign writers and a foreign reader."""
    def start(**parameters):
        peer.read('command')
        writers = {stream: peer.writer(stream) for stream in STREAMS}
        process = rig.node('controller', handshake_timeout_s=60.0, **parameters)
        peer.wait_for_status('controller', state='active')
        return process, writers

    return start


@pytest.fixture
def send(block):
    """Send some samples of every stream."""
    def publish(writers, start, stop, *streams):
        for stream in streams or STREAMS:
            writers[stream].publish(
                block(stream, start, SAMPLES[STREAMS.index(stream), start:stop]))
    return publish


def messages(**values):
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


@pytest.fixture
def change(peer):
    """Change parameters in one atomic call; return the reason for a refusal, '' for none."""
    def call(**values):
        result = peer.call(
            SetParametersAtomically, 'controller/set_parameters_atomically',
            SetParametersAtomically.Request(parameters=messages(**values))).result
        assert result.successful == (not result.reason)
        return result.reason
    return call


def test_gains_and_scheme_change_at_the_sample_that_one_call_names(
        controller, peer, send, change):
    process, writers = controller(
        changes="'[{\"at_sample\": 120, \"scheme\": \"fb\"}]'", scheme='fbff')
    first = ControllerParameters()
    send(writers, 0, 50)
    peer.wait_for_samples('command', 50)

    assert change(scheme='ff', proportional_gain=0.7, apply_at_sample=80) == ''
    assert change(proportional_gain=0.6, integral_gain_per_s=100.0, apply_at_sample=200) == ''
    assert change(proportional_gain=0.5) == ''  # at the next sample
    # A part of a call that is refused does nothing.
    assert change(scheme='fb', proportional_gain=9.0, apply_at_sample=49) == (
        'apply_at_sample is 49; the next sample is 50 already')
    assert 'it goes with gains or scheme in one call' in change(apply_at_sample=70)
    assert 'scheme is auto' in change(scheme='auto')
    assert 'measurement_delay_samples takes effect at an activation' in change(
        measurement_delay_samples=2, proportional_gain=9.0)
    assert 'command_minimum_um is 0.0 um, it must be below' in change(
        command_minimum_um=0.0, command_maximum_um=0.0)
    (alone,) = peer.call(
        SetParameters, 'controller/set_parameters',
        SetParameters.Request(parameters=messages(apply_at_sample=60))).results
    assert not alone.successful
    # What is the case already is no change.
    assert change(measurement_delay_samples=1, sample_period_s=1e-5) == ''

    # In pieces that do not end where the laws change; without feedback far ahead of what is read.
    send(writers, 50, 75)
    send(writers, 75, 110, 'reference', 'feedforward')
    peer.wait_for_samples('command', 75)
    send(writers, 75, 110, 'displacement')
    send(writers, 110, 300)
    law = first.replaced(proportional_gain=0.5)
    ff = law.replaced(scheme='ff', proportional_gain=0.7)
    fb = ff.replaced(scheme='fb')
    expected = commands(
        (0, first), (50, law), (80, ff), (120, fb),
        (200, fb.replaced(proportional_gain=0.6, integral_gain_per_s=100.0)))
    assert peer.wait_for_samples('command', 300) == expected
    status = peer.wait_for_status('controller', index=300)
    assert (status['scheme'], status['changed_at']) == ('fb', 200)
    process.wait_for('from sample 80 on: ff, kP 0.7, kI 2630 1/s')
    values = peer.call(
        GetParameters, 'controller/get_parameters', GetParameters.Request(
            names=['apply_at_sample', 'scheme', 'measurement_delay_samples'])).values
    assert [values[0].integer_value, values[1].string_value, values[2].integer_value] == [
        -1, 'ff', 1]
    assert process.exit_code is None
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('scheme', ['fbff', pytest.param('ff', marks=pytest.mark.slow)])
def test_it_joins_where_all_streams_have_begun(controller, peer, block, scheme):
    process, writers = controller(start_index=-1, scheme=scheme)
    starts = {'reference': 5000, 'feedforward': 4990, 'displacement': 5007}
    for stream, samples in zip(STREAMS, SAMPLES, strict=True):
        for start in range(0, 300, 60):
            writers[stream].publish(
                block(stream, starts[stream] + start, samples[start:start + 60]))
    begins_at = 5007 if scheme == 'fbff' else 5000
    offsets = [begins_at - starts[stream] for stream in STREAMS]
    count = 300 - max(offsets)
    law, state = ControllerParameters(scheme=scheme), initial_state(ControllerParameters())
    streams = [
        samples[max(offset, 0):max(offset, 0) + count].tolist()
        for samples, offset in zip(SAMPLES, offsets, strict=True)]
    expected = [
        controller_step(state, controller_constants(law, PERIOD_S), k, *sample)
        for k, sample in enumerate(zip(*streams, strict=False))]
    peer.wait(
        lambda: sum(len(message.data) - 2 for message in peer.received['command']) >= count,
        'the commands')
    assert peer.received['command'][0].data[0] == begins_at
    received = [value for message in peer.received['command'] for value in message.data[2:]]
    assert received[:count] == expected[:count]
    assert process.exit_code is None


@pytest.fixture
def fed_late(rig, peer):
    """Start a controller without feedforward; its writer comes when it runs already."""
    def start(scheme):
        peer.read('command')
        writers = {stream: peer.writer(stream) for stream in ('reference', 'displacement')}
        process = rig.node('controller', handshake_timeout_s=60.0, scheme=scheme)
        peer.wait_for_status('controller', state='active')
        writers['feedforward'] = peer.writer('feedforward')
        peer.wait(
            lambda: writers['feedforward'].get_subscription_count() == 1, 'the late connection')
        return process, writers
    return start


@pytest.mark.parametrize(('scheme', 'later'), [
    ('fb', 'fbff'), pytest.param('open_loop', 'ff', marks=pytest.mark.slow)])
def test_a_feedforward_that_comes_late_is_there_when_a_scheme_needs_it(
        fed_late, peer, send, change, scheme, later):
    process, writers = fed_late(scheme)
    send(writers, 0, 100)
    peer.wait_for_samples('command', 100)
    assert change(scheme=later, apply_at_sample=130) == ''
    send(writers, 100, 300)
    law = ControllerParameters(scheme=scheme)
    assert peer.wait_for_samples('command', 300) == commands(
        (0, law), (130, law.replaced(scheme=later)))
    assert process.exit_code is None


@pytest.mark.parametrize(('scheme', 'compiled'), [
    ('ff', 'true'), ('open_loop', 'false'),
    pytest.param('ff', 'false', marks=pytest.mark.slow),
    pytest.param('open_loop', 'true', marks=pytest.mark.slow)])
def test_reference_and_feedforward_may_be_cut_and_late_as_they_like(
        controller, peer, block, scheme, compiled):
    _, writers = controller(scheme=scheme, compiled=compiled)
    pieces = [
        ('reference', 0, 100), ('feedforward', 0, 3), ('feedforward', 3, 200),
        ('reference', 100, 101), ('reference', 101, 300), ('feedforward', 200, 300)]
    for stream, start, stop in pieces:
        writers[stream].publish(
            block(stream, start, SAMPLES[STREAMS.index(stream), start:stop]))
        if stop == 200:
            peer.wait_for_samples('command', 100)
    expected = commands((0, ControllerParameters(scheme=scheme)))
    assert peer.wait_for_samples('command', 300) == expected
    # The feedforward goes on for longer than the reference, which alone tells the end.
    writers['feedforward'].publish(block('feedforward', 300, [0.0, 0.0]))
    writers['reference'].publish(block('reference', 300, []))
    writers['displacement'].publish(block('displacement', 0, [*SAMPLES[2], 0.0]))
    peer.wait(lambda: len(peer.received['command'][-1].data) == 2, 'the end of the command')
    writers['feedforward'].publish(block('feedforward', 302, []))
    writers['displacement'].publish(block('displacement', 301, []))
    peer.wait_for_status('controller', state='finished', index=300)


def test_a_scheme_with_feedback_takes_over_where_blocks_wait_for_their_feedforward(
        controller, peer, block, send, change):
    _, writers = controller(scheme='ff', compiled=True)
    send(writers, 0, 50)
    peer.wait_for_samples('command', 50)
    send(writers, 50, 120, 'reference', 'displacement')
    send(writers, 50, 60, 'feedforward')
    peer.wait_for_samples('command', 60)
    assert change(scheme='fb', apply_at_sample=80) == ''
    send(writers, 60, 120, 'feedforward')
    send(writers, 120, 300)
    first = ControllerParameters(scheme='ff')
    expected = commands((0, first), (80, first.replaced(scheme='fb')))
    assert peer.wait_for_samples('command', 300) == expected
