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
Small state-space systems: series connection, exact discretisation, and the step of a sample.

Continuous and discrete form of a system with one input and one output::

    dx/dt  = A x + B u             y    = C x + D u
    x[k+1] = Ad x[k] + Bd u[k]     y[k] = C x[k] + Dd u[k]

Zero-order hold, the input constant from sample to sample::

    exp([A B; 0 0] Ts) = [Ad Bd; 0 1],   Dd = D

First-order hold, the input straight from sample to sample::

    exp([A Ts, B Ts, 0; 0 0 1; 0 0 0]) = [Ad G0 G1; 0 1 1; 0 0 1]
    x[k+1] = Ad x[k] + (G0 - G1) u[k] + G1 u[k+1]

In the state z[k] = x[k] - G1 u[k] the next input is not needed::

    z[k+1] = Ad z[k] + (Ad G1 + G0 - G1) u[k],   y[k] = C z[k] + (C G1 + D) u[k]

Zero-order hold behind a delay of (n + r) Ts, 0 <= r < 1, where u[k-1] acts during the first r Ts of
a period and u[k] during the rest::

    x[k+1] = exp(A Ts) x[k] + exp(A (1 - r) Ts) Phi(r Ts) B u[k-n-1] + Phi((1 - r) Ts) B u[k-n],
    Phi(t) = integral from 0 to t of exp(A s) ds
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model.step import Vector, step

__all__ = [
    'LinearConstants',
    'Quadratic',
    'StateSpace',
    'discretise_delayed_hold',
    'discretise_first_order_hold',
    'discretise_zero_order_hold',
    'first_order_lag',
    'frequency_response',
    'gain',
    'lags',
    'linear_constants',
    'output_then_update',
    'second_order_lag',
    'series',
    'update_then_output',
    'with_zeros',
]

_FRACTION_FLOOR: Final = 1e-9  # of a sample: a delay this close to whole samples is whole


class StateSpace(NamedTuple):
    """Matrices of a single-input single-output system with n states."""

    a: NDArray[np.float64]  # (n, n)
    b: NDArray[np.float64]  # (n, 1)
    c: NDArray[np.float64]  # (1, n)
    d: NDArray[np.float64]  # (1, 1)


def gain(value: float) -> StateSpace:
    """Return a system without states."""
    return StateSpace(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[value]]))


def first_order_lag(time_constant_s: float) -> StateSpace:
    """
    Return 1/(tau s + 1).

    Examples
    --------
    >>> lag = discretise_zero_order_hold(first_order_lag(2.0), 0.5)
    >>> round(float(lag.a[0, 0]), 6)  # exp(-0.5 / 2.0)
    0.778801

    """
    rate = 1.0 / time_constant_s
    return StateSpace(
        np.array([[-rate]]), np.array([[rate]]), np.array([[1.0]]), np.array([[0.0]]))


def second_order_lag(natural_frequency_rad_per_s: float, damping_ratio: float) -> StateSpace:
    """Return w^2/(s^2 + 2 zeta w s + w^2) in states of equal magnitude (x, dx/dt / w)."""
    w = natural_frequency_rad_per_s
    return StateSpace(
        np.array([[0.0, w], [-w, -2.0 * damping_ratio * w]]), np.array([[0.0], [w]]),
        np.array([[1.0, 0.0]]), np.array([[0.0]]))


class Quadratic(NamedTuple):
    """The factor 1 + linear s + square s^2; square is 0 for a real root."""

    linear: float  # s/rad
    square: float  # s^2/rad^2

    @classmethod
    def of_rate(cls, rate_rad_per_s: float) -> 'Quadratic':
        """Return s/r + 1."""
        return cls(1.0 / rate_rad_per_s, 0.0)

    @classmethod
    def of_pair(cls, frequency_rad_per_s: float, damping_ratio: float) -> 'Quadratic':
        """Return (s/w)^2 + 2 zeta s/w + 1."""
        w = frequency_rad_per_s
        return cls(2.0 * damping_ratio / w, 1.0 / (w * w))

    @property
    def order(self) -> int:
        """Number of its roots."""
        return 2 if self.square else 1

    @property
    def polynomial(self) -> list[float]:
        """Coefficients, highest power of s first."""
        return [self.square, self.linear, 1.0] if self.square else [self.linear, 1.0]


def lags(
    rates_rad_per_s: Sequence[float], pairs: Sequence[tuple[float, float]],
) -> StateSpace:
    """
    Return poles alone, of unit dc gain: first-order lags, then second-order ones.

    Parameters
    ----------
    rates_rad_per_s : sequence of float
        Real poles.
    pairs : sequence of (rad/s, damping ratio)
        Pole pairs.

    """
    systems = [first_order_lag(1.0 / rate) for rate in rates_rad_per_s]
    systems += [second_order_lag(*pair) for pair in pairs]
    return series(*systems) if systems else gain(1.0)


def with_zeros(zeros: Sequence[Quadratic], poles: Sequence[Quadratic]) -> StateSpace:
    """
    Return zeros over poles, of unit dc gain, as a series of sections of first and second order.

    Raises
    ------
    ValueError
        If there are more zeros than poles.

    """
    if sum(zero.order for zero in zeros) > sum(pole.order for pole in poles):
        raise ValueError('there are more zeros than poles')
    if not poles:
        return gain(1.0)
    denominators, numerators = _in_pairs(poles), _in_pairs(zeros)
    # Zeros of second order fit poles of second order, of which there are as many or more.
    single = [each for each in numerators if each.order == 1]
    numerators = [each for each in numerators if each.order == 2]
    denominators.sort(key=lambda each: -each.order)
    numerators += single
    none = Quadratic(0.0, 0.0)
    numerators += [none] * (len(denominators) - len(numerators))
    return series(*map(_section, numerators, denominators))


def _in_pairs(factors: Sequence[Quadratic]) -> list[Quadratic]:
    """Return the factors with those of first order multiplied in twos; one may be left."""
    found = [each for each in factors if each.order == 2]
    real = sorted((each for each in factors if each.order == 1), key=lambda each: each.linear)
    found += [
        Quadratic(one.linear + other.linear, one.linear * other.linear)
        for one, other in zip(real[::2], real[1::2], strict=False)]
    return found + real[len(real) - len(real) % 2:]


def _section(numerator: Quadratic, denominator: Quadratic) -> StateSpace:
    """Return a numerator over a denominator of the same order or higher."""
    if denominator.order == 1:
        rate = 1.0 / denominator.linear
        lag = first_order_lag(denominator.linear)
        return StateSpace(
            lag.a, lag.b, np.array([[1.0 - numerator.linear * rate]]),
            np.array([[numerator.linear * rate]]))
    w = 1.0 / math.sqrt(denominator.square)
    damping = 0.5 * denominator.linear * w
    lag = second_order_lag(w, damping)
    linear, square = numerator.linear * w, numerator.square * w * w
    return StateSpace(
        lag.a, lag.b, np.array([[1.0 - square, linear - 2.0 * damping * square]]),
        np.array([[square]]))


def frequency_response(
    system: StateSpace, points: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Return C (p I - A)^-1 B + D at points p, shape (N,): of s, or of z for a discrete one."""
    order = len(system.a)
    pencil = points[:, None, None] * np.eye(order) - system.a
    states = np.linalg.solve(pencil, np.broadcast_to(system.b, (points.size, order, 1)))
    return np.asarray((system.c @ states)[:, 0, 0] + system.d[0, 0])


def series(*systems: StateSpace) -> StateSpace:
    """Return the series connection, the first system taking the input."""
    whole = systems[0]
    for system in systems[1:]:
        n, m = whole.a.shape[0], system.a.shape[0]
        a = np.zeros((n + m, n + m))
        a[:n, :n], a[n:, :n], a[n:, n:] = whole.a, system.b @ whole.c, system.a
        whole = StateSpace(
            a, np.concatenate([whole.b, system.b @ whole.d]),
            np.concatenate([system.d @ whole.c, system.c], axis=1), system.d @ whole.d)
    return whole


def discretise_zero_order_hold(system: StateSpace, sample_period_s: float) -> StateSpace:
    """Return the exact samples of a system with an input that is constant between them."""
    _check_sample_period(sample_period_s)
    n = system.a.shape[0]
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n] = system.a * sample_period_s
    augmented[:n, n:] = system.b * sample_period_s
    exponential = _exponential(augmented)
    return StateSpace(exponential[:n, :n], exponential[:n, n:], system.c, system.d)


def discretise_delayed_hold(
    system: StateSpace, sample_period_s: float, delay_s: float,
) -> tuple[StateSpace, int]:
    """
    Return the exact samples of a system behind a zero-order hold and a pure delay.

    Parameters
    ----------
    system : StateSpace
        The continuous system, without feedthrough.
    sample_period_s : float
        Sample period, seconds.
    delay_s : float
        The delay, seconds, not below 0.

    Returns
    -------
    system : StateSpace
        The discrete system; a delay of a fraction of a sample adds a state.
    whole : int
        Whole samples of delay that remain.

    """
    discrete = discretise_zero_order_hold(system, sample_period_s)
    whole = math.floor(delay_s / sample_period_s + _FRACTION_FLOOR)
    late_s = delay_s - whole * sample_period_s
    if late_s <= _FRACTION_FLOOR * sample_period_s:
        return discrete, whole
    # u[k-1] acts during the first late_s of the period, u[k] during the rest.
    order = system.a.shape[0]
    early = discretise_zero_order_hold(system, sample_period_s - late_s)
    late = discretise_zero_order_hold(system, late_s)
    a = np.zeros((order + 1, order + 1))
    a[:order, :order] = discrete.a
    a[:order, order:] = early.a @ late.b
    b = np.vstack([early.b, [[1.0]]])
    c = np.hstack([discrete.c, [[0.0]]])
    return StateSpace(a, b, c, discrete.d), whole


def discretise_first_order_hold(system: StateSpace, sample_period_s: float) -> StateSpace:
    """
    Return the exact samples of a system with an input that is straight from sample to sample.

    The state of the result is shifted by the present input, see the module.
    """
    _check_sample_period(sample_period_s)
    n = system.a.shape[0]
    augmented = np.zeros((n + 2, n + 2))
    augmented[:n, :n] = system.a * sample_period_s
    augmented[:n, n:n + 1] = system.b * sample_period_s
    augmented[n, n + 1] = 1.0
    exponential = _exponential(augmented)
    a = exponential[:n, :n]
    ramp = exponential[:n, n + 1:]  # share of the next input
    constant = exponential[:n, n:n + 1] - ramp  # share of the present input
    return StateSpace(a, a @ ramp + constant, system.c, system.c @ ramp + system.d)


def _check_sample_period(sample_period_s: float) -> None:
    if not 0.0 < sample_period_s < math.inf:
        raise ValueError(
            f'sample_period_s is {sample_period_s}, it must be finite and above 0 s')


class LinearConstants(NamedTuple):
    """A discrete system for the steps, row by row; lists in a node, arrays in a kernel."""

    a: Any  # (n * n,)
    b: Any  # (n,)
    c: Any  # (n,)
    d: float


def linear_constants(system: StateSpace) -> LinearConstants:
    """Return the constants of the steps as lists."""
    return LinearConstants(
        system.a.ravel().tolist(), system.b.ravel().tolist(), system.c.ravel().tolist(),
        float(system.d[0, 0]))


@step
def output_then_update(
    state: Vector, scratch: Vector, constants: LinearConstants, value: float,
) -> float:
    """Return ``C x[k] + D u[k]`` and move the state on to k + 1."""
    a, b, c, d = constants
    order = len(state)
    if order == 3:  # written out: the mechanics with the sensor, once per sample
        x0, x1, x2 = state[0], state[1], state[2]
        state[0] = b[0] * value + a[0] * x0 + a[1] * x1 + a[2] * x2
        state[1] = b[1] * value + a[3] * x0 + a[4] * x1 + a[5] * x2
        state[2] = b[2] * value + a[6] * x0 + a[7] * x1 + a[8] * x2
        output: float = d * value + c[0] * x0 + c[1] * x1 + c[2] * x2
        return output
    output = d * value
    for i in range(order):
        output += c[i] * state[i]
    _update(state, scratch, constants, value)
    return output


@step
def update_then_output(
    state: Vector, scratch: Vector, constants: LinearConstants, value: float,
) -> float:
    """Move the state on to k + 1 under the held ``u[k]`` and return ``C x[k+1]`` (D is zero)."""
    a, b, c, _ = constants
    order = len(state)
    if order == 2:  # written out: the amplifier, once per sample
        x0, x1 = state[0], state[1]
        next_0 = b[0] * value + a[0] * x0 + a[1] * x1
        next_1 = b[1] * value + a[2] * x0 + a[3] * x1
        state[0] = next_0
        state[1] = next_1
        output: float = c[0] * next_0 + c[1] * next_1
        return output
    _update(state, scratch, constants, value)
    output = 0.0
    for i in range(order):
        output += c[i] * state[i]
    return output


@step
def _update(state: Vector, scratch: Vector, constants: LinearConstants, value: float) -> None:
    a = constants.a
    b = constants.b
    order = len(state)
    position = 0
    for i in range(order):
        total = b[i] * value
        for j in range(order):
            total += a[position] * state[j]
            position += 1
        scratch[i] = total
    for i in range(order):
        state[i] = scratch[i]


def _exponential(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponential of a square matrix, not to be changed: it is shared."""
    return _exponential_of(matrix.tobytes(), len(matrix))


@lru_cache(maxsize=64)  # rigs that differ in one part have the others in common
def _exponential_of(content: bytes, order: int) -> NDArray[np.float64]:
    # Here, for it takes a fifth of the memory of a node, and most nodes discretise nothing.
    from scipy.linalg import expm
    exponential: NDArray[np.float64] = expm(
        np.frombuffer(content).reshape(order, order).copy())
    exponential.setflags(write=False)
    return exponential
