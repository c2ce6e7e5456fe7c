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

"""Whether a run has settled and is stable: made-up courses of which the answer is known."""

import numpy as np
import pytest

from piezo_ros.report.settling import settling, settling_periods

SAMPLES_PER_PERIOD = 1000 / 3  # no whole number, as 300 Hz at 10 us


def course(periods=8, samples_per_period=SAMPLES_PER_PERIOD):
    """Return the phase in periods, a triangle of 1 um and what lags behind it."""
    turns = np.arange(round(periods * samples_per_period)) / samples_per_period

    def triangle(at):
        return 2 / np.pi * np.arcsin(np.sin(2 * np.pi * at))

    # As smooth as a stage: harmonics up to the 19th.
    lagging = sum(
        8 / np.pi**2 * (-1) ** n * np.sin(2 * np.pi * (2 * n + 1) * (turns - 0.02)) / (2 * n + 1)**2
        for n in range(10))
    return turns, triangle(turns), lagging


def found(reference, displacement, samples_per_period=SAMPLES_PER_PERIOD, scored=4):
    kept = round((scored + 2 * settling_periods(scored)) * samples_per_period)
    return settling(reference[-kept:], displacement[-kept:], samples_per_period, scored)


# Few samples in a period leave the error of interpolation between them.
@pytest.mark.parametrize(('samples_per_period', 'most_percent'), [
    (SAMPLES_PER_PERIOD, 0.01), (100.0, 1e-9), (33.3, 0.5), (1234.5, 0.001)])
def test_a_steady_run_has_settled_and_is_stable(samples_per_period, most_percent):
    _, reference, displacement = course(12, samples_per_period)
    result = found(reference, displacement, samples_per_period)
    assert result.is_settled
    assert result.is_stable
    assert result.change_percent < most_percent


@pytest.mark.parametrize('noise_um', [1e-4, 1e-2, 0.1])
def test_noise_is_no_change(noise_um):
    _, reference, displacement = course()
    noise = np.random.default_rng(1).normal(0.0, noise_um, displacement.size)
    result = found(reference, displacement + noise)
    assert result.is_settled
    assert result.is_stable
    assert result.change_percent < 0.01


@pytest.mark.parametrize('slow', [2.0, 5.0])
def test_what_decays_slowly_has_not_settled(slow):
    turns, reference, displacement = course()
    result = found(reference, displacement + 0.2 * np.exp(-turns / slow))
    assert not result.is_settled
    assert result.is_stable


def test_what_has_decayed_has_settled():
    turns, reference, displacement = course()
    assert found(reference, displacement + 0.2 * np.exp(-turns / 0.5)).is_settled


@pytest.mark.parametrize('cycles', [7.3, 16.45, 0.9 * SAMPLES_PER_PERIOD / 2])
@pytest.mark.parametrize('growth', [0.0, 0.3])
def test_an_oscillation_that_does_not_decay_is_unstable(cycles, growth):
    turns, reference, displacement = course()
    ringing = 0.1 * np.exp(growth * (turns - turns[-1])) * np.sin(2 * np.pi * cycles * turns)
    assert not found(reference, displacement + ringing).is_stable


def test_an_oscillation_that_decays_is_stable_but_has_not_settled():
    turns, reference, displacement = course()
    ringing = 0.2 * np.exp(-turns / 3) * np.sin(2 * np.pi * 7.3 * turns)
    result = found(reference, displacement + ringing)
    assert result.is_stable
    assert not result.is_settled


def test_hum_and_drift_are_not_called_unstable():
    turns, reference, displacement = course()
    for slow in (0.1 * np.sin(2 * np.pi * turns / 6), 0.05 * turns):
        result = found(reference, displacement + slow)
        assert result.is_stable
        assert not result.is_settled


@pytest.mark.parametrize('periods', [0.5, 1.0, 1.9])
def test_less_than_two_periods_tell_nothing(periods):
    _, reference, displacement = course(periods)
    assert settling(reference, displacement, SAMPLES_PER_PERIOD, 0.5) is None


def test_a_reference_that_does_not_repeat_tells_nothing():
    turns, reference, displacement = course()
    assert found(reference * turns, displacement * turns) is None
    assert found(np.zeros(2667), displacement) is None
