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
The linear dynamics of the hysteresis-compensated actuator: (6) in Liu 2015, or any other G(s).

From linearised command (um) to displacement (um), the structure ``liu``::

    G(s) = k (s^2 + b1 s + b2) / [(s + 1/tau) (s^2 + 2 z1 w1 s + w1^2) (s^2 + 2 z2 w2 s + w2^2)]

It is the series of amplifier, mechanics and sensor::

    Ga(s) = w1^2 / (s^2 + 2 z1 w1 s + w1^2)
    Gp(s) = G(0) (w2^2 / b2) (s^2 + b1 s + b2) / (s^2 + 2 z2 w2 s + w2^2)
    Gs(s) = 1 / (tau s + 1)
    G(0)  = k b2 tau / (w1 w2)^2

With Table 2 the zeros lie in the right half plane: 1/G(s) is unstable, 1/G at single frequencies
is not.

The structure ``sections``, with lists of real zeros and poles and of pairs of them::

    G(s) = G(0) prod (s/r + 1) prod ((s/w)^2 + 2 z s/w + 1) / [the same of the poles]

Both have a pure delay, exp(-s T). The hysteresis H stands within G: some of the poles, the first
ones of their lists, are before it, the others behind it with all zeros; where the delay stands does
not matter, since H has no rate::

    G(s) = exp(-s T) Gbehind(s) Gbefore(s),   Gbefore(0) = 1
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper
from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.state_space import (
    Quadratic,
    StateSpace,
    discretise_delayed_hold,
    discretise_zero_order_hold,
    first_order_lag,
    frequency_response,
    gain,
    lags,
    second_order_lag,
    series,
    with_zeros,
)

if TYPE_CHECKING:
    import control

__all__ = ['DynamicsParameters', 'LinearDynamics']


_LISTS: Final = (
    'pole_rates_rad_per_s', 'pole_frequencies_rad_per_s', 'pole_damping_ratios',
    'zero_rates_rad_per_s', 'zero_frequencies_rad_per_s', 'zero_damping_ratios')
_LOWEST_RATE: Final = 1e-3  # rad/s
_HIGHEST_RATE: Final = 1e9


@dataclass(frozen=True, kw_only=True)
class DynamicsParameters(ParameterSet):
    """The parameters of G(s): those of (6), by default Table 2 in Liu 2015, or sections."""

    dynamics: str = parameter(
        'liu', '', 'structure of G(s): liu, (6) with its eight parameters, or sections, with the '
        'lists of poles and zeros', choices=('liu', 'sections'))
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

    gain_um_per_um: float = parameter(
        1.0, 'um/um', 'sections: dc gain', minimum=1e-9, maximum=1e9)
    pole_rates_rad_per_s: tuple[float, ...] = parameter(
        (), 'rad/s', 'sections: rates r of the real poles, 1/(s/r + 1)',
        minimum=_LOWEST_RATE, maximum=_HIGHEST_RATE)
    pole_frequencies_rad_per_s: tuple[float, ...] = parameter(
        (), 'rad/s', 'sections: natural frequencies w of the pole pairs, '
        '1/((s/w)^2 + 2 z s/w + 1)', minimum=_LOWEST_RATE, maximum=_HIGHEST_RATE)
    pole_damping_ratios: tuple[float, ...] = parameter(
        (), '', 'sections: damping ratios z of the pole pairs', minimum=1e-6, maximum=1e2)
    zero_rates_rad_per_s: tuple[float, ...] = parameter(
        (), 'rad/s', 'sections: rates r of the real zeros, (s/r + 1); negative in the right half '
        'plane, not 0', minimum=-_HIGHEST_RATE, maximum=_HIGHEST_RATE)
    zero_frequencies_rad_per_s: tuple[float, ...] = parameter(
        (), 'rad/s', 'sections: natural frequencies w of the pairs of zeros, '
        '((s/w)^2 + 2 z s/w + 1)', minimum=_LOWEST_RATE, maximum=_HIGHEST_RATE)
    zero_damping_ratios: tuple[float, ...] = parameter(
        (), '', 'sections: damping ratios z of the pairs of zeros; negative in the right half '
        'plane', minimum=-1e2, maximum=1e2)
    delay_s: float = parameter(
        0.0, 's', 'pure delay, of either structure', minimum=0.0, maximum=10.0)
    rates_before_hysteresis: int = parameter(
        0, '', 'how many of the first real poles are before the hysteresis; of (6) the sensor pole',
        minimum=0, maximum=100)
    pairs_before_hysteresis: int = parameter(
        1, '', 'how many of the first pole pairs are before the hysteresis; of (6) 1 is the '
        'amplifier', minimum=0, maximum=100)
    hysteresis_place: str = parameter(
        'known', '', 'whether these two numbers are known, or the measurement could not decide '
        'them', choices=('known', 'undecided'))

    def check_together(self) -> None:
        """Refuse lists that are not those of the structure, or no causal and stable system."""
        super().check_together()
        if self.dynamics == 'liu':
            for name in (*_LISTS, 'gain_um_per_um'):
                value = getattr(self, name)
                if value not in ((), 1.0):
                    raise ParameterError(
                        f'{name} is {_listed(value)}, but dynamics is liu, which has its own '
                        'parameters; it belongs to dynamics: sections')
        else:
            self._check_sections()
        rates, pairs = self.rates_rad_per_s, self.pole_pairs
        for name, number, there in (
            ('rates_before_hysteresis', self.rates_before_hysteresis, len(rates)),
            ('pairs_before_hysteresis', self.pairs_before_hysteresis, len(pairs)),
        ):
            # One pair before H is the default; it is none where there is no pair.
            if number > there and not (name.startswith('pairs') and number == 1):
                raise ParameterError(f'{name} is {number}, allowed is 0 … {there} (of these poles)')
        behind = len(rates) + 2 * len(pairs) - self.order_before
        zeros = sum(zero.order for zero in self.zeros)
        if zeros > behind:
            raise ParameterError(
                f'rates_before_hysteresis is {self.rates_before_hysteresis} and '
                f'pairs_before_hysteresis {self.pairs_before_hysteresis}: that leaves {behind} '
                f'poles behind the hysteresis to {zeros} zeros; there must be at least as many')

    def _check_sections(self) -> None:
        for kind in ('pole', 'zero'):
            frequencies, ratios = (
                getattr(self, f'{kind}_{name}')
                for name in ('frequencies_rad_per_s', 'damping_ratios'))
            if len(frequencies) != len(ratios):
                raise ParameterError(
                    f'{kind}_frequencies_rad_per_s has {len(frequencies)} values and '
                    f'{kind}_damping_ratios {len(ratios)}; there must be one for each pair')
        for rate in self.zero_rates_rad_per_s:
            if abs(rate) < _LOWEST_RATE:
                raise ParameterError(
                    f'zero_rates_rad_per_s is {rate} rad/s, allowed is {_LOWEST_RATE:g} … '
                    f'{_HIGHEST_RATE:g} rad/s and the same below 0')
        poles = len(self.pole_rates_rad_per_s) + 2 * len(self.pole_frequencies_rad_per_s)
        zeros = len(self.zero_rates_rad_per_s) + 2 * len(self.zero_frequencies_rad_per_s)
        if zeros >= poles:
            raise ParameterError(
                f'dynamics is sections, with {poles} poles and {zeros} zeros (a pair counts '
                'twice); there must be fewer zeros than poles')

    @property
    def rates_rad_per_s(self) -> tuple[float, ...]:
        """Rates of the real poles of either structure."""
        if self.dynamics == 'liu':
            return (1.0 / self.time_constant_s,)
        return self.pole_rates_rad_per_s

    @property
    def pole_pairs(self) -> tuple[tuple[float, float], ...]:
        """Natural frequency (rad/s) and damping ratio of the pole pairs of either structure."""
        if self.dynamics == 'liu':
            return (
                (self.natural_frequency_1_rad_per_s, self.damping_ratio_1),
                (self.natural_frequency_2_rad_per_s, self.damping_ratio_2))
        return tuple(
            zip(self.pole_frequencies_rad_per_s, self.pole_damping_ratios, strict=True))

    @property
    def zeros(self) -> tuple[Quadratic, ...]:
        """The factors of the numerator of either structure, each 1 at s = 0."""
        if self.dynamics == 'liu':
            b2 = self.zero_b2_rad2_per_s2
            return (Quadratic(self.zero_b1_rad_per_s / b2, 1.0 / b2),)
        return (
            *map(Quadratic.of_rate, self.zero_rates_rad_per_s),
            *map(Quadratic.of_pair, self.zero_frequencies_rad_per_s, self.zero_damping_ratios))

    @property
    def poles(self) -> tuple[Quadratic, ...]:
        """The factors of the denominator of either structure, each 1 at s = 0."""
        return (
            *map(Quadratic.of_rate, self.rates_rad_per_s),
            *(Quadratic.of_pair(*pair) for pair in self.pole_pairs))

    @property
    def order_before(self) -> int:
        """Number of poles before the hysteresis."""
        pairs = min(self.pairs_before_hysteresis, len(self.pole_pairs))
        return self.rates_before_hysteresis + 2 * pairs

    @property
    def dc_gain(self) -> float:
        """G(0), micrometres per micrometre."""
        if self.dynamics == 'sections':
            return self.gain_um_per_um
        return (
            self.gain_k_rad3_per_s3 * self.zero_b2_rad2_per_s2 * self.time_constant_s
            / (self.natural_frequency_1_rad_per_s * self.natural_frequency_2_rad_per_s) ** 2)


def _listed(value: Any) -> str:
    return str(list(value)) if isinstance(value, tuple) else str(value)


class LinearDynamics:
    """
    G(s), (6) in Liu 2015 or any other, as transfer function, response and sampled system.

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
        """Numerator and denominator without the delay, highest power of s first."""
        p = self.parameters
        if p.dynamics == 'sections':
            return p.dc_gain * _product(p.zeros), _product(p.poles)
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
        """G(s) without its delay as a continuous-time ``control.TransferFunction``."""
        import control
        return control.tf(*self.polynomials, inputs='command_um', outputs='displacement_um')

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return G(i 2 pi f), with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        Returns
        -------
        ndarray of complex, shape (N,)
            The frequency response, micrometres per micrometre.

        """
        s = np.asarray(
            2j * np.pi * np.asarray(frequency_hz, dtype=np.float64), dtype=np.complex128)
        p = self.parameters
        if p.dynamics == 'sections':  # factor by factor: high powers of s lose digits
            value = p.dc_gain * _values(p.zeros, s) / _values(p.poles, s)
        else:
            numerator, denominator = self.polynomials
            value = np.asarray(np.polyval(numerator, s) / np.polyval(denominator, s))
        return value * np.exp(-s * p.delay_s) if p.delay_s else value

    def sampled_response(
        self, frequency_hz: ArrayLike, sample_period_s: float,
    ) -> NDArray[np.complex128]:
        """
        Return the response v[k] -> y[k] of G behind a zero-order hold, with the delay.

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
        system, whole = discretise_delayed_hold(self._whole, sample_period_s, self.delay_s)
        z = np.exp(2j * np.pi * np.atleast_1d(frequency_hz) * sample_period_s)
        value = frequency_response(system, z)
        return value * z ** -float(whole) if whole else value

    @property
    def delay_s(self) -> float:
        """The pure delay, seconds."""
        return self.parameters.delay_s

    @property
    def dc_gain(self) -> float:
        """G(0), micrometres per micrometre."""
        return self.parameters.dc_gain

    @property
    def before_hysteresis(self) -> StateSpace:
        """What is before the hysteresis, without the delay; unit dc gain, no feedthrough."""
        p = self.parameters
        return lags(
            p.rates_rad_per_s[:p.rates_before_hysteresis],
            p.pole_pairs[:p.pairs_before_hysteresis])

    @property
    def behind_hysteresis(self) -> StateSpace:
        """What is behind the hysteresis, without the delay; carries the dc gain of G."""
        p = self.parameters
        if (p.dynamics, p.rates_before_hysteresis, p.pairs_before_hysteresis) == ('liu', 0, 1):
            return self.mechanics_and_sensor
        poles = (
            *map(Quadratic.of_rate, p.rates_rad_per_s[p.rates_before_hysteresis:]),
            *(Quadratic.of_pair(*pair) for pair in p.pole_pairs[p.pairs_before_hysteresis:]))
        return series(with_zeros(p.zeros, poles), gain(p.dc_gain))

    @property
    def _whole(self) -> StateSpace:
        return series(self.before_hysteresis, self.behind_hysteresis)

    @property
    def amplifier(self) -> StateSpace:
        """The amplifier poles of (6), unit dc gain."""
        p = self.parameters
        return second_order_lag(p.natural_frequency_1_rad_per_s, p.damping_ratio_1)

    @property
    def mechanics_and_sensor(self) -> StateSpace:
        """The mechanics of (6) with the zeros, then the sensor pole; carries its dc gain."""
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
        Return G without its delay, sampled behind a zero-order hold, exact at the samples.

        Parameters
        ----------
        sample_period_s : float
            Sample period, seconds.

        Returns
        -------
        StateSpace
            Discrete-time system, ``y[k] = C x[k]``, ``x[k+1] = A x[k] + B v[k]``.

        Raises
        ------
        ValueError
            If the sample period is not finite and positive.

        """
        return discretise_zero_order_hold(self._whole, sample_period_s)


def _product(factors: tuple[Quadratic, ...]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = np.ones(1)
    for factor in factors:
        product = np.asarray(np.polymul(product, factor.polynomial), dtype=np.float64)
    return product


def _values(factors: tuple[Quadratic, ...], s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    value = np.ones_like(s)
    for factor in factors:
        value = value * (1.0 + s * (factor.linear + s * factor.square))
    return value
