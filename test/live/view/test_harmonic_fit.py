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

"""Harmonics from single samples: what they are, how well they are known, and when they are not."""

import numpy as np
import pytest

from piezo_ros.live.view.harmonic_fit import HarmonicFitError, covered_share, fit_harmonics

PERIOD = 1000.0 / 3.0


def _signal(indices, noise=0.0, seed=1):
    phases = 2.0 * np.pi * np.asarray(indices) / PERIOD
    rest = noise * np.random.default_rng(seed).standard_normal(len(indices))
    return 0.2 + 3.0 * np.cos(phases) + 0.5 * np.sin(5.0 * phases) + rest


def _indices(count=400, seed=2):
    return np.cumsum(np.random.default_rng(seed).integers(80, 260, count))


def test_samples_far_apart_tell_the_harmonics():
    indices = _indices()
    fit = fit_harmonics(indices, _signal(indices), PERIOD)
    expected = np.zeros(40)
    expected[[0, 4]] = 3.0, 0.5
    np.testing.assert_allclose(fit.amplitudes, expected, atol=1e-9)
    assert fit.mean == pytest.approx(0.2)
    assert fit.rest_rms < 1e-9


def test_the_standard_errors_are_those_of_repeated_fits():
    indices = _indices()
    fits = [fit_harmonics(indices, _signal(indices, 0.3, seed), PERIOD) for seed in range(60)]
    spread = np.std([fit.amplitudes[[0, 4]] for fit in fits], axis=0)
    told = np.mean([fit.standard_errors[[0, 4]] for fit in fits], axis=0)
    np.testing.assert_allclose(told, spread, rtol=0.4)


def test_what_is_not_periodic_is_told_apart():
    indices = _indices()
    fit = fit_harmonics(indices, _signal(indices, 0.3), PERIOD)
    assert fit.rest_rms == pytest.approx(0.3, rel=0.2)


def test_no_harmonic_is_at_or_above_half_of_the_sampling_frequency():
    indices = np.arange(400)
    fit = fit_harmonics(indices, np.sin(2.0 * np.pi * indices / 8.0 + 0.1), 8.0 + 1e-3)
    assert fit.amplitudes.size == 4
    fit = fit_harmonics(np.arange(4000), np.ones(4000), 23.5)
    assert fit.amplitudes.size == 11


@pytest.mark.parametrize(('indices', 'period', 'words'), [
    (np.arange(39), 5.0, '39 samples so far, 40 are needed'),
    (np.arange(50), PERIOD, 'cover 15% of the period'),
    # Stroboscopic: every sample is at one of two phases.
    (np.arange(400) * 50, 100.0, 'cover 10% of the period'),
    (np.arange(400), 2.0, 'the period has 2 samples, above 2 are needed')])
def test_samples_that_do_not_tell_are_refused(indices, period, words):
    with pytest.raises(HarmonicFitError, match=words):
        fit_harmonics(indices, np.ones(indices.size), period)


def test_phases_that_are_always_the_same_do_not_tell_high_harmonics():
    # Twenty phases are met, in each part of the period one: harmonic 20 is seen as the mean.
    indices = np.arange(600) * 5 + 2
    with pytest.raises(HarmonicFitError, match='always meet the same phases'):
        fit_harmonics(indices, _signal(indices), 100.0)


def test_the_share_of_the_period_that_is_covered():
    assert covered_share([0, 1, 2, 3], 4.0) == 1.0
    assert covered_share([0, 1, 2, 3], 400.0) == pytest.approx(1 / 20)
    assert covered_share(np.arange(100), 100.0) == 1.0
