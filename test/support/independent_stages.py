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

"""Stages of modes and lags and their responses behind a hold, without the models of the package."""

import numpy as np
from scipy.linalg import expm
from scipy.signal import tf2ss

from piezo_ros.identification.response.frequency_response import FrequencyResponse


def mode(frequency_hz, damping, share=1.0):
    w = 2.0 * np.pi * frequency_hz
    return np.array([share * w * w]), np.array([1.0, 2.0 * damping * w, w * w])


def lag(frequency_hz):
    w = 2.0 * np.pi * frequency_hz
    return np.array([w]), np.array([1.0, w])


def parallel(first, *others):
    for other in others:
        first = (
            np.polyadd(np.polymul(first[0], other[1]), np.polymul(other[0], first[1])),
            np.polymul(first[1], other[1]))
    return first


def series(first, second):
    return np.polymul(first[0], second[0]), np.polymul(first[1], second[1])


# Numerator and denominator in s, and the delay in seconds.
STAGES = {
    'one mode': (mode(700.0, 0.03), 0.0),
    'two close modes': (parallel(mode(800.0, 0.02, 0.6), mode(880.0, 0.015, 0.4)), 0.0),
    'mode and delay': (mode(700.0, 0.05), 1.7e-4),
    'antiresonance': (parallel(mode(500.0, 0.02, 0.7), mode(1500.0, 0.03, 0.3)), 0.0),
    'lag before': (series(lag(400.0), mode(1200.0, 0.04)), 0.0),
    'lag behind': (series(mode(300.0, 0.05), lag(2500.0)), 0.0),
    'first order': (lag(150.0), 0.0),
    'four modes': (parallel(
        mode(300.0, 0.02, 0.4), mode(700.0, 0.02, 0.3), mode(1100.0, 0.02, 0.2),
        mode(1700.0, 0.02, 0.1)), 0.0),
}
ORDERS = {
    'one mode': (0, 2, False), 'two close modes': (2, 4, False), 'mode and delay': (0, 2, True),
    'antiresonance': (2, 4, False), 'lag before': (0, 3, False), 'lag behind': (0, 3, False),
    'first order': (0, 1, False), 'four modes': (6, 8, False),
}


def slowed(stage, factor):
    """Return a stage with all frequencies divided by a factor."""
    (numerator, denominator), delay_s = stage
    return tuple(
        polynomial * factor**np.arange(polynomial.size - 1, -1, -1.0)
        for polynomial in (numerator, denominator)), delay_s * factor


def truth(stage, frequency_hz, sample_period_s):
    """Return the response behind a zero-order hold: exact discretisation, delay by its parts."""
    polynomials, delay_s = stage
    a, b, c, _ = tf2ss(*polynomials)
    order = a.shape[0]
    whole = int(np.floor(delay_s / sample_period_s + 1e-9))
    late = max(delay_s - whole * sample_period_s, 0.0)

    def held(time_s):
        block = np.zeros((order + 1, order + 1))
        block[:order] = np.hstack([a, b])
        exponential = expm(block * time_s)
        return exponential[:order, :order], exponential[:order, order:]

    full, _ = held(sample_period_s)
    early, now = held(sample_period_s - late)
    _, before = held(late)
    z = np.exp(2j * np.pi * np.asarray(frequency_hz) * sample_period_s)
    return np.array([
        (c @ np.linalg.solve(one * np.eye(order) - full, now + early @ before / one))[0, 0]
        * one**-whole for one in z])


def measured(stage, frequency_hz, sample_period_s, noise, seed=0):
    """Return points with circular Gaussian errors of a known size."""
    exact = truth(stage, frequency_hz, sample_period_s)
    generator = np.random.default_rng(seed)
    size = exact.size
    error = noise * (generator.normal(size=size) + 1j * generator.normal(size=size)) / np.sqrt(2.0)
    one = np.ones(size)
    return FrequencyResponse(
        np.asarray(frequency_hz), exact + error, noise**2 * one, one, 0.0 * one, one, 0.0 * one,
        sample_period_s)
