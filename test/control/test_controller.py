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

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.control import SCHEMES, ControllerParameters
from piezo_ros.control.controller_step import (
    ANTI_WINDUP,
    controller_constants,
    controller_step,
    initial_state,
    prepare_transfer,
)
from piezo_ros.model import ParameterError

PERIOD_S = 1e-5
KP, KI = 0.239, 2630.0
LIMIT_UM = 1.7
FEEDBACK_SCHEMES = ('fb', 'fbff')
errors = st.floats(-5.0, 5.0)


def parameters_of(scheme='fb', **values):
    values = {'bumpless_start': False, 'measurement_delay_samples': 0, **values}
    return ControllerParameters(scheme=scheme, **values)


class Loop:
    """A controller fed sample by sample."""

    def __init__(self, parameters):
        self.state = initial_state(parameters)
        self.constants = controller_constants(parameters, PERIOD_S)
        self.index = 0

    def __call__(self, reference=0.0, feedforward=0.0, measured=0.0):
        command = controller_step(
            self.state, self.constants, self.index, reference, feedforward, measured)
        self.index += 1
        return command

    def change(self, parameters):
        self.constants = controller_constants(parameters, PERIOD_S)
        prepare_transfer(self.state)


def random_streams(count=300, seed=0):
    return np.random.default_rng(seed).normal(size=(3, count))


def commands(parameters, streams):
    loop = Loop(parameters)
    return np.array([loop(*sample) for sample in streams.T.tolist()])


@pytest.mark.parametrize('scheme', SCHEMES)
def test_each_scheme_has_its_own_law(scheme):
    streams = random_streams()
    reference, feedforward, measured = streams
    error = reference - measured
    feedback = KP * error + KI * PERIOD_S * np.cumsum(error)
    expected = {
        'fb': feedback, 'ff': feedforward, 'fbff': feedback + feedforward, 'open_loop': reference}
    np.testing.assert_allclose(
        commands(parameters_of(scheme), streams), expected[scheme], rtol=0, atol=1e-12)


@pytest.mark.parametrize('scheme', ['ff', 'open_loop'])
def test_without_feedback_the_measurement_does_not_matter(scheme):
    streams = random_streams()
    other = streams.copy()
    other[2] = 1e3
    parameters = parameters_of(scheme)
    assert commands(parameters, streams).tobytes() == commands(parameters, other).tobytes()


def test_the_integral_of_a_sample_holds_its_own_error_already():
    loop = Loop(parameters_of(proportional_gain=0.0, integral_gain_per_s=1000.0))
    assert loop(reference=1.0) == pytest.approx(0.01, rel=1e-14)
    assert loop(reference=1.0) == pytest.approx(0.02, rel=1e-14)
    assert loop(reference=0.0) == pytest.approx(0.02, rel=1e-14)


@pytest.mark.parametrize('delay', [0, 1, 3])
def test_the_error_is_formed_with_a_measurement_of_the_stated_age(delay):
    streams = random_streams()
    parameters = parameters_of(integral_gain_per_s=0.0, measurement_delay_samples=delay)
    reference, _, measured = streams
    # Before the first sample the stage was where it is at the first.
    aged = np.concatenate([np.full(delay, measured[0]), measured])[:measured.size]
    np.testing.assert_allclose(
        commands(parameters, streams), KP * (reference - aged), rtol=0, atol=1e-14)


@pytest.mark.parametrize(('reference_delay', 'measurement_delay'), [(1, 0), (1, 1), (3, 1), (2, 4)])
def test_the_reference_of_the_error_has_the_stated_age_too(reference_delay, measurement_delay):
    streams = random_streams()
    parameters = parameters_of(
        integral_gain_per_s=0.0, measurement_delay_samples=measurement_delay,
        reference_delay_samples=reference_delay)
    reference, _, measured = streams
    wanted, aged = (
        np.concatenate([np.full(delay, values[0]), values])[:values.size]
        for delay, values in ((reference_delay, reference), (measurement_delay, measured)))
    np.testing.assert_allclose(
        commands(parameters, streams), KP * (wanted - aged), rtol=0, atol=1e-14)


def test_references_of_a_time_without_feedback_are_remembered():
    streams = random_streams()
    loop = Loop(parameters_of('ff', reference_delay_samples=2))
    for sample in streams.T[:10].tolist():
        loop(*sample)
    loop.change(parameters_of('fbff', integral_gain_per_s=0.0, reference_delay_samples=2))
    loop.state.memory[2] = 0.0  # without the transfer
    loop.state.memory[0] = 0.0
    reference, feedforward, measured = streams[:, 10]
    assert loop(reference, feedforward, measured) == pytest.approx(
        feedforward + KP * (streams[0, 8] - measured))


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('anti_windup', ANTI_WINDUP)
def test_no_command_leaves_its_limits(scheme, anti_windup):
    streams = 10.0 * random_streams()
    parameters = parameters_of(
        scheme, anti_windup=anti_windup, command_minimum_um=-1.0, command_maximum_um=LIMIT_UM)
    values = commands(parameters, streams)
    assert values.min() == -1.0
    assert values.max() == LIMIT_UM


def tracked(anti_windup, held_samples):
    """A stage that follows the command at once is asked for too much, then for little."""
    loop = Loop(parameters_of(
        'fb', anti_windup=anti_windup, command_minimum_um=-LIMIT_UM, command_maximum_um=LIMIT_UM))
    measured, record = 0.0, []
    for reference in [3.0] * held_samples + [1.0] * 1000:
        measured = loop(reference=reference, measured=measured)
        record.append(measured)
    return np.array(record[held_samples:])


@pytest.mark.parametrize('anti_windup', ['clamping', 'back_calculation'])
def test_the_integral_does_not_wind_up_while_the_command_is_at_a_limit(anti_windup):
    after = tracked(anti_windup, held_samples=5000)
    assert after[0] < LIMIT_UM
    assert after.min() > 1.0 - 0.3  # the proportional kick, no undershoot of a wound-up integral
    assert after[-1] == pytest.approx(1.0, abs=1e-3)
    # How long it was held there leaves no trace.
    np.testing.assert_allclose(after, tracked(anti_windup, held_samples=20000), atol=0.05)


def test_without_anti_windup_it_does_wind_up():
    after = tracked('none', held_samples=5000)
    assert np.all(after == LIMIT_UM)


def test_back_calculation_leaves_just_the_integral_that_meets_the_limit():
    loop = Loop(parameters_of(
        integral_gain_per_s=1e4, anti_windup='back_calculation', command_maximum_um=LIMIT_UM))
    values = [loop(reference=5.0) for _ in range(100)]
    assert values[-90:] == [LIMIT_UM] * 90
    assert loop.state.memory[0] == pytest.approx(LIMIT_UM - KP * 5.0, rel=1e-12)


def test_clamping_lets_the_integral_move_back_from_the_limit():
    loop = Loop(parameters_of(
        'fbff', anti_windup='clamping', command_maximum_um=LIMIT_UM))
    assert loop(reference=1.0, feedforward=9.0) == LIMIT_UM
    assert loop.state.memory[0] == 0.0
    assert loop(reference=-1.0, feedforward=9.0) == LIMIT_UM
    assert loop.state.memory[0] == pytest.approx(-KI * PERIOD_S)


@pytest.mark.parametrize('scheme', FEEDBACK_SCHEMES)
@given(reference=errors, feedforward=errors, measured=errors)
def test_a_bumpless_start_begins_at_the_command_of_rest(scheme, reference, feedforward, measured):
    loop = Loop(parameters_of(scheme, bumpless_start=True))
    assert loop(reference, feedforward, measured) == pytest.approx(0.0, abs=1e-14)
    error = reference - measured
    assert loop(reference, feedforward, measured) == pytest.approx(
        KI * PERIOD_S * error, abs=1e-13)


@pytest.mark.parametrize(('before', 'after'), itertools.product(SCHEMES, FEEDBACK_SCHEMES))
@pytest.mark.parametrize('anti_windup', ANTI_WINDUP)
def test_gains_and_scheme_change_without_a_bump(before, after, anti_windup):
    rng = np.random.default_rng(7)
    for _ in range(200):
        kp, ki = rng.uniform(0.0, 2.0), rng.uniform(0.0, 1e4)
        limits = {'command_minimum_um': -LIMIT_UM, 'command_maximum_um': LIMIT_UM,
                  'anti_windup': anti_windup}
        loop = Loop(parameters_of(before, **limits))
        # Every other time the old command is at a limit, where rounding decides.
        size = rng.choice([0.1, 10.0])
        for sample in rng.normal(0.0, size, (20, 3)).tolist():
            last = loop(*sample)
        loop.change(parameters_of(
            after, proportional_gain=kp, integral_gain_per_s=ki, **limits))
        reference, feedforward, measured = rng.normal(0.0, 5.0, 3).tolist()
        assert loop(reference, feedforward, measured) == pytest.approx(last, abs=1e-12)
        # And it goes on from there, as an integral does.
        error = reference - measured
        following = np.clip(last + ki * PERIOD_S * error, -LIMIT_UM, LIMIT_UM)
        assert loop(reference, feedforward, measured) == pytest.approx(following, abs=1e-12)


@pytest.mark.parametrize('name', [
    'proportional_gain', 'integral_gain_per_s', 'command_minimum_um', 'command_maximum_um',
    'measurement_delay_samples'])
@pytest.mark.parametrize('bad', [float('nan'), float('inf'), float('-inf')])
def test_no_gain_or_limit_can_carry_a_nan_into_the_integral(name, bad):
    with pytest.raises(ParameterError, match=f'^{name} is {bad}'):
        ControllerParameters(**{name: bad})


@pytest.mark.parametrize(('values', 'message'), [
    ({'command_minimum_um': 0.0, 'command_maximum_um': 0.0},
     'command_minimum_um is 0.0 um, it must be below command_maximum_um 0.0 um'),
    ({'scheme': 'pid'}, "scheme is 'pid', allowed are fb, ff, fbff, open_loop"),
    ({'anti_windup': 'some'}, "anti_windup is 'some', allowed are clamping, back_calculation, "),
    ({'proportional_gain': -0.1}, 'proportional_gain is -0.1 um/um, allowed is 0 … 1e+06 um/um'),
    ({'reference_delay_samples': -1}, 'reference_delay_samples is -1 samples, allowed'),
    ({'measurement_delay_samples': 1001}, 'measurement_delay_samples is 1001 samples, allowed'),
])
def test_a_controller_that_cannot_be_is_refused(values, message):
    with pytest.raises(ParameterError) as refusal:
        ControllerParameters(**values)
    assert str(refusal.value).startswith(message)


def test_a_reset_state_forgets_everything():
    parameters = ControllerParameters()
    loop = Loop(parameters)
    for sample in random_streams().T.tolist():
        loop(*sample)
    assert loop.state != initial_state(parameters)
    assert initial_state(parameters) == initial_state(parameters)
    assert initial_state(parameters).memory[:2] == [0.0, 0.0]


TABLE = {
    'feedback_acceptable_amplitude_um': [0.5, 1.5, 2.5],
    'feedback_acceptable_frequency_hz': [450.0, 650.0, 550.0]}


@pytest.mark.parametrize(('scan_hz', 'scan_um', 'table', 'scheme'), [
    (300.0, 0.0, {'feedback_acceptable_frequency_hz': [450.0]}, 'fbff'),
    (450.0, 0.0, {'feedback_acceptable_frequency_hz': [450.0]}, 'ff'),
    (800.0, 0.0, {'feedback_acceptable_frequency_hz': [450.0]}, 'ff'),
    (500.0, 0.5, TABLE, 'ff'),
    (500.0, 1.0, TABLE, 'fbff'),
    (560.0, 1.0, TABLE, 'ff'),
    (560.0, 2.5, TABLE, 'ff'),
    (560.0, 2.0, TABLE, 'fbff'),
])
def test_auto_is_fbff_where_feedback_is_acceptable_and_ff_elsewhere(
        scan_hz, scan_um, table, scheme):
    auto = parameters_of('auto', scan_frequency_hz=scan_hz, scan_amplitude_um=scan_um, **table)
    concrete = parameters_of(scheme)
    assert auto.concrete_scheme == scheme
    assert (auto.uses_feedback, auto.uses_feedforward) == (scheme == 'fbff', True)
    assert controller_constants(auto, PERIOD_S) == controller_constants(concrete, PERIOD_S)
    streams = random_streams()
    assert commands(auto, streams).tobytes() == commands(concrete, streams).tobytes()


@pytest.mark.parametrize('scheme', SCHEMES)
def test_the_table_has_no_part_in_a_scheme_that_is_given(scheme):
    given_too = parameters_of(scheme, scan_frequency_hz=100.0, scan_amplitude_um=1.0, **TABLE)
    assert given_too.concrete_scheme == parameters_of(scheme).concrete_scheme == scheme


@pytest.mark.parametrize(('values', 'words'), [
    ({}, 'feedback_acceptable_frequency_hz is 0 Hz at every amplitude'),
    ({'scan_frequency_hz': 300.0}, 'feedback_acceptable_frequency_hz is 0 Hz at every amplitude'),
    ({'feedback_acceptable_frequency_hz': [450.0]}, 'scan_frequency_hz is 0, which is unknown'),
    ({'scan_frequency_hz': 300.0, **TABLE}, 'scan_amplitude_um is 0, which is unknown'),
])
def test_auto_without_what_it_decides_by_is_refused(values, words):
    with pytest.raises(ParameterError, match=f'scheme is auto, and {words}'):
        ControllerParameters(scheme='auto', **values)


@pytest.mark.parametrize(('values', 'words'), [
    ({'feedback_acceptable_amplitude_um': [1.0, 2.0]}, '_um has 2 values and .*_hz 1'),
    ({**TABLE, 'feedback_acceptable_amplitude_um': [0.5, 0.5, 1.0]}, 'the values must ascend'),
    ({'feedback_acceptable_amplitude_um': [], 'feedback_acceptable_frequency_hz': []},
     'one at least'),
])
def test_a_table_that_is_none_is_refused_whatever_the_scheme(values, words):
    with pytest.raises(ParameterError, match=words):
        ControllerParameters(**values)
