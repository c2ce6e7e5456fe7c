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
A linear plant G(s) with delay, continuous or sampled behind a zero-order hold.

With the state-space form (A, B, C) of G, the sample period T and the delay (n + r) T, 0 <= r < 1,
the sampled plant v[k] -> y[k] is exact:

    x[k+1] = exp(A T) x[k] + exp(A (1 - r) T) Phi(r T) B v[k-1] + Phi((1 - r) T) B v[k]
    y[k] = C x[k-n],   Phi(t) = integral from 0 to t of exp(A s) ds

Examples
--------
A lag of 1 ms sampled every 1 ms, behind a delay of half a sample:

>>> lag = LinearPlant(np.array([1.0]), np.array([1e-3, 1.0]), delay_s=5e-4)
>>> sampled = lag.sampled(1e-3)
>>> sampled.system.b.round(4).ravel()
array([0.3935, 1.    ])
>>> round(abs(complex(sampled.response([1e-3])[0])), 6)
1.0

"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.model.state_space import StateSpace, discretise_delayed_hold, frequency_response

__all__ = ['Bound', 'LinearPlant', 'Model', 'SampledPlant', 'bound_magnitude']


class SupportsPolynomials(Protocol):
    """A model with a rational G(s): `LinearDynamics`, `DynamicsFit`."""

    @property
    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numerator and denominator, highest power of s first."""


@runtime_checkable
class SupportsMagnitude(Protocol):
    """A bound of the uncertainty: `UncertaintyBound`."""

    def magnitude(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return |W(i 2 pi f)|."""


@runtime_checkable
class TransferFunction(Protocol):
    """The attributes of a ``control.TransferFunction`` that are used here."""

    num: Any
    den: Any
    dt: Any
    ninputs: Any
    noutputs: Any


Model: TypeAlias = SupportsPolynomials | TransferFunction
Bound: TypeAlias = (
    SupportsMagnitude | TransferFunction | Callable[[NDArray[np.float64]], ArrayLike])


def bound_magnitude(bound: Bound, frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """
    Return |W|, or a measured |Delta|, at given frequencies.

    Parameters
    ----------
    bound : UncertaintyBound, control.TransferFunction or callable
        W(s), (19) in Liu 2015, or a function of the frequency in hertz.
    frequency_hz : array_like, shape (N,)
        Frequencies, hertz.

    Returns
    -------
    ndarray, shape (N,)
        The magnitudes.

    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    if isinstance(bound, SupportsMagnitude):
        return np.asarray(bound.magnitude(frequency), dtype=np.float64)
    if isinstance(bound, TransferFunction):
        values: ArrayLike = LinearPlant.of(bound).response(frequency)
    else:
        values = bound(frequency)
    return np.asarray(np.abs(np.asarray(values)), dtype=np.float64)


@dataclass(frozen=True)
class LinearPlant:
    """
    A continuous plant G(s) with a pure delay.

    Attributes
    ----------
    numerator, denominator : ndarray
        Polynomials in s, rad/s, highest power first.
    delay_s : float
        Pure delay, seconds.

    """

    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    delay_s: float = 0.0

    @classmethod
    def of(cls, model: Model) -> 'LinearPlant':
        """
        Return any linear model as a plant.

        Parameters
        ----------
        model : LinearDynamics, DynamicsFit, control.TransferFunction or LinearPlant
            The model; its ``delay_s``, if it has one, is kept.

        Raises
        ------
        ValueError
            If a transfer function is not of continuous time, or has several inputs or outputs.

        """
        if isinstance(model, cls):
            return model
        if isinstance(model, TransferFunction):
            if model.dt:
                raise ValueError(
                    f'the transfer function has the sample period {model.dt}, it must be of '
                    'continuous time: the hold is added here')
            if (model.ninputs, model.noutputs) != (1, 1):
                raise ValueError(
                    f'the transfer function has {model.ninputs} inputs and '
                    f'{model.noutputs} outputs, it must have one of each')
            numerator, denominator = model.num[0][0], model.den[0][0]
        else:
            numerator, denominator = model.polynomials
        return cls(
            np.trim_zeros(np.atleast_1d(np.asarray(numerator, dtype=np.float64)), 'f'),
            np.trim_zeros(np.atleast_1d(np.asarray(denominator, dtype=np.float64)), 'f'),
            float(getattr(model, 'delay_s', 0.0)))

    @property
    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numerator and denominator, highest power of s first."""
        return self.numerator, self.denominator

    @property
    def poles_rad_per_s(self) -> NDArray[np.complex128]:
        """Poles of G(s)."""
        return np.asarray(np.roots(self.denominator), dtype=np.complex128)

    @property
    def dc_gain(self) -> float:
        """G(0), infinite for an integrating plant."""
        if self.denominator[-1] == 0.0:
            return math.inf
        return float(self.numerator[-1] / self.denominator[-1])

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the continuous G(i 2 pi f), with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        """
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        return np.asarray(
            np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
            * np.exp(-s * self.delay_s))

    @property
    def state_space(self) -> StateSpace:
        """
        G(s) without its delay as a state-space system.

        Raises
        ------
        ValueError
            If G(s) does not vanish at high frequencies: y[k] would depend on v[k].

        """
        order = self.denominator.size - 1
        if self.numerator.size > order:
            raise ValueError(
                f'G(s) has the numerator order {self.numerator.size - 1} and the denominator '
                f'order {order}, the numerator must be of lower order')
        # Companion form in s over the mean pole frequency: all entries are near one.
        scale = _mean_rate(self.poles_rad_per_s)
        powers = scale ** np.arange(order, -1, -1.0)
        leading = self.denominator[0] * powers[0]
        denominator = self.denominator * powers / leading
        numerator = np.zeros(order)
        numerator[order - self.numerator.size:] = (
            self.numerator * powers[-self.numerator.size:] / leading)
        a = np.zeros((order, order))
        a[0] = -denominator[1:]
        a[1:, :-1] = np.eye(order - 1)
        b = np.zeros((order, 1))
        b[0] = scale
        return StateSpace(scale * a, b, numerator[None, :], np.zeros((1, 1)))

    def sampled(self, sample_period_s: float) -> 'SampledPlant':
        """
        Return the plant sampled behind a zero-order hold.

        Parameters
        ----------
        sample_period_s : float
            Sample period, seconds.

        Raises
        ------
        ValueError
            If the period is not positive and finite, or G(s) does not vanish at high frequencies.

        """
        return SampledPlant(
            *discretise_delayed_hold(self.state_space, sample_period_s, self.delay_s),
            sample_period_s)


@dataclass(frozen=True)
class SampledPlant:
    """
    A plant sampled behind a zero-order hold.

    Attributes
    ----------
    system : StateSpace
        ``x[k+1] = A x[k] + B v[k]``, ``C x[k]`` is the output before the whole delay.
    delay_samples : int
        Whole samples of delay of the output.
    sample_period_s : float
        Sample period, seconds.

    """

    system: StateSpace
    delay_samples: int
    sample_period_s: float

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the response v[k] -> y[k].

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies up to the Nyquist frequency, hertz.

        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        z = np.exp(2j * np.pi * frequency.ravel() * self.sample_period_s)
        value = frequency_response(self.system, z) * z ** -float(self.delay_samples)
        return np.asarray(value.reshape(frequency.shape))


def _mean_rate(poles_rad_per_s: NDArray[np.complex128]) -> float:
    rates = np.abs(poles_rad_per_s)
    rates = rates[rates > 0.0]
    return float(np.exp(np.mean(np.log(rates)))) if rates.size else 1.0
