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

"""
Fits of one frequency response by this package and by its peers: error and time.

The peers are scikit-rf's vector fitting and scipy's least squares from twenty random starts. All
take the same points and have the same orders; the error is that against the true response, over
its largest value. Run as ``python -m benchmarks.response_peers [CSV]``; without a CSV file of
``piezo identify dynamics`` the points of three stages are made here.
"""

import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from piezo_ros.identification import FrequencyResponse, fit_dynamics
from piezo_ros.identification.response.response_csv import read_response

__all__ = ['PEERS', 'STAGES', 'Score', 'made_points', 'missing_peer', 'score', 'table']

_PERIOD_S: Final = 1e-5
_NOISE: Final = 1e-3
_STARTS: Final = 20

Array = NDArray[np.complex128]
Fitted = Callable[[NDArray[np.float64]], Array]


class Stage(NamedTuple):
    """Modes in parallel: natural frequencies (Hz), damping ratios, shares of the dc gain."""

    frequencies_hz: tuple[float, ...]
    damping: tuple[float, ...]
    shares: tuple[float, ...]

    def response(self, frequency_hz: NDArray[np.float64]) -> Array:
        """Return the response behind a zero-order hold, by its residues."""
        z = np.exp(2j * np.pi * frequency_hz * _PERIOD_S)
        value = np.zeros(z.size, dtype=np.complex128)
        for natural_hz, ratio, share in zip(
                self.frequencies_hz, self.damping, self.shares, strict=True):
            w = 2.0 * np.pi * natural_hz
            pole = w * complex(-ratio, np.sqrt(1.0 - ratio**2))
            residue = share * w * w / (2j * pole.imag)
            for p, r in ((pole, residue), (pole.conjugate(), residue.conjugate())):
                held = np.exp(p * _PERIOD_S)
                value += r / p * (held - 1.0) / (z - held)
        return value


STAGES: Final = {
    '0/2': Stage((700.0,), (0.03,), (1.0,)),
    '2/4': Stage((800.0, 880.0), (0.02, 0.015), (0.6, 0.4)),
    '6/8': Stage(
        (300.0, 700.0, 1100.0, 1700.0), (0.02, 0.02, 0.02, 0.02), (0.4, 0.3, 0.2, 0.1)),
}


class Score(NamedTuple):
    """Root mean square error over the largest response, and seconds; NaN if not installed."""

    error: float
    seconds: float


def _without_hold(points: FrequencyResponse) -> Array:
    turn = 2j * np.pi * points.frequency_hz * points.sample_period_s
    return np.asarray(points.response * turn / -np.expm1(-turn))


def _hold(frequency_hz: NDArray[np.float64], sample_period_s: float) -> Array:
    turn = 2j * np.pi * frequency_hz * sample_period_s
    return np.asarray(-np.expm1(-turn) / turn)


def fit_here(points: FrequencyResponse, zeros: int, poles: int) -> Fitted:
    """Fit by this package, with standard errors."""
    return fit_dynamics(
        points, structure='rational', numerator_order=zeros,
        denominator_order=poles).sampled_response


def fit_by_vector_fitting(points: FrequencyResponse, zeros: int, poles: int) -> Fitted:
    """Fit by scikit-rf; the orders are those of its partial fractions."""
    import skrf
    from skrf.vectorFitting import VectorFitting
    frequency = skrf.Frequency.from_f(points.frequency_hz, unit='hz')
    network = skrf.Network(frequency=frequency, s=_without_hold(points).reshape(-1, 1, 1), z0=50)
    fitting = VectorFitting(network)
    fitting.vector_fit(
        n_poles_real=poles % 2, n_poles_cmplx=poles // 2, fit_constant=False,
        fit_proportional=False)
    return lambda frequency_hz: np.asarray(
        fitting.get_model_response(0, 0, frequency_hz) * _hold(
            frequency_hz, points.sample_period_s))


def fit_by_least_squares(points: FrequencyResponse, zeros: int, poles: int) -> Fitted:
    """Fit by scipy from random starts: sections of the denominator, a polynomial over them."""
    s = 1j * points.frequency_hz / points.frequency_hz[-1]
    target = _without_hold(points)
    pairs, powers = poles // 2, np.arange(zeros + 1)

    def over(vector: NDArray[np.float64], at: Array) -> Array:
        value = np.ones(at.size, dtype=np.complex128)
        vector = np.clip(vector, -10.0, 10.0)
        for w, ratio in zip(
                np.exp(vector[:pairs]), np.exp(vector[pairs:2 * pairs]), strict=True):
            value = value / ((at / w)**2 + 2.0 * ratio * at / w + 1.0)
        return value if poles % 2 == 0 else value / (at / np.exp(vector[2 * pairs]) + 1.0)

    def model(vector: NDArray[np.float64], at: Array) -> Array:
        return np.asarray(over(vector, at) * (at[:, None]**powers @ vector[poles:]))

    def residual(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        error = (model(vector, s) - target) / points.standard_error
        return np.nan_to_num(np.concatenate([error.real, error.imag]), nan=1e9, posinf=1e9)

    generator = np.random.default_rng(0)
    found = []
    for _ in range(_STARTS):
        start = np.concatenate([
            np.log(generator.uniform(0.05, 1.0, pairs)),
            np.log(generator.uniform(0.01, 0.3, pairs)),
            np.log(generator.uniform(0.05, 1.0, poles % 2)), np.eye(zeros + 1)[0]])
        found.append(least_squares(residual, start, x_scale='jac', method='trf', max_nfev=200))
    best = min(found, key=lambda one: float(one.cost)).x
    return lambda frequency_hz: np.asarray(
        model(best, 1j * frequency_hz / points.frequency_hz[-1])
        * _hold(frequency_hz, points.sample_period_s))


PEERS: Final = {
    'piezo_ros': fit_here,
    'scikit-rf': fit_by_vector_fitting,
    'scipy': fit_by_least_squares,
}


def missing_peer(name: str) -> str:
    """Return what a peer needs that is not installed; '' for nothing."""
    if name == 'scikit-rf' and importlib.util.find_spec('skrf') is None:
        return 'needs the package scikit-rf (pip install scikit-rf)'
    return ''


def score(
    fit: Callable[[FrequencyResponse, int, int], Fitted], points: FrequencyResponse,
    truth: Array, orders: tuple[int, int],
) -> Score:
    """Return error and time of one fit; NaN where its library is not installed."""
    started = time.perf_counter()
    try:
        model = fit(points, *orders)
    except ImportError:
        return Score(np.nan, np.nan)
    seconds = time.perf_counter() - started
    error = model(points.frequency_hz) - truth
    return Score(
        float(np.sqrt(np.mean(np.abs(error)**2)) / np.abs(truth).max()), seconds)


def made_points(stage: Stage, number: int = 250) -> tuple[FrequencyResponse, Array]:
    """Return noisy points of a stage, and the true response."""
    frequency_hz = np.geomspace(20.0, 3000.0, number)
    truth = stage.response(frequency_hz)
    generator = np.random.default_rng(1)
    noise = _NOISE * (
        generator.normal(size=number) + 1j * generator.normal(size=number)) / np.sqrt(2.0)
    one = np.ones(number)
    return FrequencyResponse(
        frequency_hz, truth + noise, _NOISE**2 * one, one, 0.0 * one, one, 0.0 * one,
        _PERIOD_S), truth


def table(sets: dict[str, tuple[FrequencyResponse, Array]]) -> str:
    """Return a table of errors and times, the columns by points, the rows by package."""
    lines = ['orders    package        error %     seconds']
    for name, (points, truth) in sets.items():
        zeros, poles = (int(order) for order in name.split('/'))
        for peer, fit in PEERS.items():
            error, seconds = score(fit, points, truth, (zeros, poles))
            lines.append(
                f'{name:9} {peer:12} {100.0 * error:9.4f} {seconds:11.2f}' if error == error
                else f'{name:9} {peer:12} skipped: not installed')
    return '\n'.join(lines)


def main(arguments: list[str]) -> int:
    """Print the table."""
    if arguments:
        points = read_response(Path(arguments[0]))
        # Of measured points the truth is not known: the error is that of the points.
        print(table(dict.fromkeys(STAGES, (points, points.response))))
    else:
        print(table({orders: made_points(stage) for orders, stage in STAGES.items()}))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
