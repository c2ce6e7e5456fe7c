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
The fifth-order linear dynamics of the hysteresis-compensated actuator, (6) in Liu 2015.

From linearised command (um) to displacement (um)::

    G(s) = k (s^2 + b1 s + b2) / [(s + 1/tau) (s^2 + 2 z1 w1 s + w1^2) (s^2 + 2 z2 w2 s + w2^2)]

It is the series of amplifier, mechanics and sensor::

    Ga(s) = w1^2 / (s^2 + 2 z1 w1 s + w1^2)
    Gp(s) = G(0) (w2^2 / b2) (s^2 + b1 s + b2) / (s^2 + 2 z2 w2 s + w2^2)
    Gs(s) = 1 / (tau s + 1)
    G(0)  = k b2 tau / (w1 w2)^2

With Table 2 the zeros lie in the right half plane: 1/G(s) is unstable, 1/G at single frequencies
is not.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper
from piezo_ros.model.parameters import ParameterSet, parameter
from piezo_ros.model.state_space import (
    StateSpace,
    discretise_zero_order_hold,
    first_order_lag,
    gain,
    second_order_lag,
    series,
)

if TYPE_CHECKING:
    import control

__all__ = ['DynamicsParameters', 'LinearDynamics']


@dataclass(frozen=True, kw_only=True)
class DynamicsParameters(ParameterSet):
    """The parameters of (6), Table 2 in Liu 2015 by default."""

    gain_k_rad3_per_s3: float = parameter(
        paper.TABLE_2['gain_k_rad3_per_s3'], 'rad^3/s^3', 'gain k of G(s)',
        minimum=1e-24, maximum=1e24)
    zero_b1_rad_per_s: float = parameter(
        paper.TABLE_2['zero_b1_rad_per_s'], 'rad/s', 'coefficient b1 of the zeros of G(s)',
        minimum=-1e9, maximum=1e9)
    zero_b2_rad2_per_s2: float = parameter(
        paper.TABLE_2['zero_b2_rad2_per_s2'], 'rad^2/s^2', 'coefficient b2 of the zeros of G(s)',
        minimum=1.0, maximum=1e18)
    time_constant_s: float = parameter(
        paper.TABLE_2['time_constant_s'], 's', 'time constant tau of the sensor',
        minimum=1e-9, maximum=1e3)
    damping_ratio_1: float = parameter(
        paper.TABLE_2['damping_ratio_1'], '', 'damping ratio zeta_1 of the amplifier poles',
        minimum=1e-6, maximum=1e2)
    natural_frequency_1_rad_per_s: float = parameter(
        paper.TABLE_2['natural_frequency_1_rad_per_s'], 'rad/s',
        'natural frequency omega_1 of the amplifier poles', minimum=1e-3, maximum=1e9)
    damping_ratio_2: float = parameter(
        paper.TABLE_2['damping_ratio_2'], '', 'damping ratio zeta_2 of the mechanics',
        minimum=1e-6, maximum=1e2)
    natural_frequency_2_rad_per_s: float = parameter(
        paper.TABLE_2['natural_frequency_2_rad_per_s'], 'rad/s',
        'natural frequency omega_2 of the mechanics', minimum=1e-3, maximum=1e9)

    @property
    def dc_gain(self) -> float:
        """G(0), micrometres per micrometre."""
        return (
            self.gain_k_rad3_per_s3 * self.zero_b2_rad2_per_s2 * self.time_constant_s
            / (self.natural_frequency_1_rad_per_s * self.natural_frequency_2_rad_per_s) ** 2)


class LinearDynamics:
    """
    G(s) of (6) in Liu 2015 as transfer function, frequency response and sampled system.

    Parameters
    ----------
    parameters : DynamicsParameters, optional
        Table 2 in Liu 2015 by default.

    Examples
    --------
    >>> dynamics = LinearDynamics()
    >>> round(dynamics.parameters.dc_gain, 3)
    0.988
    >>> [round(gain, 3) for gain in abs(dynamics.response([300.0, 800.0])).tolist()]
    [0.949, 0.784]

    Behind the zero-order hold of a converter at 100 kHz, the response at 800 Hz differs by 2.5 %:

    >>> sampled = dynamics.sampled_response([800.0], 1e-5) / dynamics.response([800.0])
    >>> round(float(abs(sampled[0] - 1.0)), 3)
    0.025

    """

    def __init__(self, parameters: DynamicsParameters | None = None) -> None:
        self.parameters = parameters or DynamicsParameters()

    @property
    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numerator, shape (3,), and denominator, shape (6,), highest power of s first."""
        p = self.parameters
        numerator = p.gain_k_rad3_per_s3 * np.array(
            [1.0, p.zero_b1_rad_per_s, p.zero_b2_rad2_per_s2])
        w1, w2 = p.natural_frequency_1_rad_per_s, p.natural_frequency_2_rad_per_s
        denominator = np.polymul(
            [1.0, 1.0 / p.time_constant_s],
            np.polymul([1.0, 2.0 * p.damping_ratio_1 * w1, w1 * w1],
                       [1.0, 2.0 * p.damping_ratio_2 * w2, w2 * w2]))
        return numerator, denominator

    @property
    def transfer_function(self) -> 'control.TransferFunction':
        """G(s) as a continuous-time ``control.TransferFunction``."""
        import control
        return control.tf(*self.polynomials, inputs='command_um', outputs='displacement_um')

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return G(i 2 pi f).

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        Returns
        -------
        ndarray of complex, shape (N,)
            The frequency response, micrometres per micrometre.

        """
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        numerator, denominator = self.polynomials
        return np.asarray(np.polyval(numerator, s) / np.polyval(denominator, s))

    def sampled_response(
        self, frequency_hz: ArrayLike, sample_period_s: float,
    ) -> NDArray[np.complex128]:
        """
        Return the response v[k] -> y[k] of G behind a zero-order hold.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.
        sample_period_s : float
            Sample period, seconds.

        Returns
        -------
        ndarray of complex, shape (N,)
            The frequency response, micrometres per micrometre.

        """
        system = self.discrete(sample_period_s)
        z = np.exp(2j * np.pi * np.atleast_1d(frequency_hz) * sample_period_s)
        pencil = z[:, None, None] * np.eye(len(system.a)) - system.a
        states = np.linalg.solve(pencil, np.broadcast_to(system.b, (z.size, *system.b.shape)))
        return np.asarray((system.c @ states)[:, 0, 0])

    @property
    def amplifier(self) -> StateSpace:
        """The amplifier poles, unit dc gain."""
        p = self.parameters
        return second_order_lag(p.natural_frequency_1_rad_per_s, p.damping_ratio_1)

    @property
    def mechanics_and_sensor(self) -> StateSpace:
        """The mechanics with the zeros, then the sensor pole; carries the dc gain of G."""
        p = self.parameters
        w2 = p.natural_frequency_2_rad_per_s
        # (s^2 + b1 s + b2)/b2 over the poles; the lag's states are x1 and its derivative over w2.
        lag = second_order_lag(w2, p.damping_ratio_2)
        b1, b2 = p.zero_b1_rad_per_s, p.zero_b2_rad2_per_s2
        ratio = w2 * w2 / b2
        mechanics = StateSpace(
            lag.a, lag.b,
            np.array([[1.0 - ratio, (b1 * w2 - 2.0 * p.damping_ratio_2 * w2 * w2) / b2]]),
            np.array([[ratio]]))
        return series(mechanics, first_order_lag(p.time_constant_s), gain(p.dc_gain))

    def discrete(self, sample_period_s: float) -> StateSpace:
        """
        Return G sampled behind a zero-order hold, exact at the samples.

        Parameters
        ----------
        sample_period_s : float
            Sample period, seconds.

        Returns
        -------
        StateSpace
            Discrete-time system of order 5, ``y[k] = C x[k]``, ``x[k+1] = A x[k] + B v[k]``.

        Raises
        ------
        ValueError
            If the sample period is not finite and positive.

        """
        return discretise_zero_order_hold(
            series(self.amplifier, self.mechanics_and_sensor), sample_period_s)
