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
Linear dynamics G(s) fitted to a measured frequency response, with standard errors.

    G(s) = k (s^2 + b1 s + b2) / ((s + 1/tau)(s^2 + 2 z1 w1 s + w1^2)(s^2 + 2 z2 w2 s + w2^2))

is (6) in Liu 2015; any other stable rational function, with a delay, can be fitted too. A record
v[k] -> y[k] shows G behind the zero-order hold, so this sampled response is fitted: at 100 kHz the
hold alone changes the response by 2.5 % at 800 Hz. The result is the continuous G(s).

Examples
--------
A lag of 1 ms, 1/(s/1000 + 1), sampled every 0.1 ms behind a hold:

>>> frequency_hz = np.geomspace(10.0, 1000.0, 20)
>>> pole = math.exp(-0.1)
>>> sampled = (1.0 - pole) / (np.exp(2j * np.pi * frequency_hz * 1e-4) - pole)
>>> zeros = np.zeros(20)
>>> measured = FrequencyResponse(
...     frequency_hz, sampled, variance=zeros + 1e-8, coherence=zeros + 1.0, distortion=zeros,
...     amplitude=zeros + 1.0, offset=zeros, sample_period_s=1e-4)
>>> fit = fit_dynamics(measured, structure='rational', numerator_order=0, denominator_order=1)
>>> round(fit.values['rate_1_rad_per_s'], 3)
1000.0

"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.identification.response.rational_fit import RationalProblem, fit_rational
from piezo_ros.identification.response.rational_model import (
    Sections,
    Shape,
    polynomials,
    response,
    sampled_response,
)
from piezo_ros.identification.yaml_text import yaml_number
from piezo_ros.model.dynamics import DynamicsParameters
from piezo_ros.model.parameters import constraint_of

if TYPE_CHECKING:
    import control

__all__ = ['STRUCTURES', 'DynamicsFit', 'fit_dynamics']

STRUCTURES = ('liu', 'rational')
MODEL_FORMAT_VERSION = 1
_LIU_SHAPE = Shape(numerator_order=2, first_order=1, second_order=2)
_NORMAL_95 = 1.959964


@dataclass(frozen=True)
class DynamicsFit:
    """
    Identified linear dynamics with their uncertainty.

    Attributes
    ----------
    structure : str
        ``'liu'`` for (6), else ``'rational'``.
    parameters : DynamicsParameters or None
        The parameters of (6); None for another structure.
    values, standard_errors : mapping of str to float
        Every fitted parameter by name and its standard error, from the residual of the points.
    delay_s : float
        Pure delay, the known and the fitted part together; not part of `transfer_function`.
    sample_period_s : float
        Sample period of the record, seconds.
    reduced_chi_squared : float
        Squared residual over that of the noise; far above 1 the structure does not fit.
    model_error : float
        Error of the structure over the geometric mean of the response and its largest value, added
        to the noise when the points are weighted.
    frequency_range_hz : tuple of float
        Lowest and highest fitted frequency.
    points : int
        Number of fitted points.

    """

    structure: str
    parameters: DynamicsParameters | None
    values: Mapping[str, float]
    standard_errors: Mapping[str, float]
    delay_s: float
    sample_period_s: float
    reduced_chi_squared: float
    model_error: float
    frequency_range_hz: tuple[float, float]
    points: int
    _sections: Sections
    _reference_rad_per_s: float
    _covariance: NDArray[np.float64]  # of the parameter vector

    @property
    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numerator and monic denominator of G(s), highest power of s first."""
        return polynomials(self._sections, self._reference_rad_per_s)

    @property
    def transfer_function(self) -> 'control.TransferFunction':
        """G(s) without the delay as a continuous-time ``control.TransferFunction``."""
        import control
        return control.tf(*self.polynomials, inputs='command_um', outputs='displacement_um')

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the continuous G(i 2 pi f), with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        """
        s = np.asarray(1j * self._scaled(frequency_hz), dtype=np.complex128)
        return response(self._sections, s)[0]

    def sampled_response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the response v[k] -> y[k] behind the zero-order hold, with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        """
        return self._sampled(frequency_hz)[0]

    def response_standard_error(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Return the standard error of the sampled response, ``E|error|**2`` rooted, shape (N,).

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        """
        jacobian = self._sampled(frequency_hz)[1][:, :self._covariance.shape[0]]
        variance = np.einsum('np,pq,nq->n', jacobian, self._covariance, jacobian.conj())
        return np.asarray(np.sqrt(np.maximum(variance.real, 0.0)))

    def confidence_interval(self, name: str) -> tuple[float, float]:
        """
        Return the bounds that contain the true parameter in 95 % of cases.

        Parameters
        ----------
        name : str
            A name in `values`.

        """
        half = _NORMAL_95 * self.standard_errors[name]
        return self.values[name] - half, self.values[name] + half

    def to_parameter_yaml(self, source: str) -> str:
        """
        Return a ROS parameter file for the trajectory node, standard errors as comments.

        Parameters
        ----------
        source : str
            Origin of the record, for instance the name of the bag.

        Raises
        ------
        ValueError
            If the structure is not (6), the only one that the node has.

        """
        if self.parameters is None:
            raise ValueError(
                f'structure {self.structure!r} has no parameter file: the trajectory node has '
                "only 'liu', (6)")
        low, high = self.frequency_range_hz
        text = [
            '# Linear dynamics (6) identified by piezo_ros.',
            f'# model format_version: {MODEL_FORMAT_VERSION}',
            *(f'# source: {line}' for line in source.splitlines() or ['']),
            f'# {self.points} points, {low:.6g} ... {high:.6g} Hz',
            f'# sample period {self.sample_period_s:.9g} s, known delay {self.delay_s:.9g} s',
            f'# reduced chi squared {self.reduced_chi_squared:.4g}',
            f'# model error {self.model_error:.3g}',
            '/**/trajectory:',
            '  ros__parameters:',
        ]
        fields = self.parameters.__dataclass_fields__
        for name in self.standard_errors:
            value = getattr(self.parameters, name)
            unit = constraint_of(fields[name]).unit
            error = f'{self.standard_errors[name]:.3g} {unit}'.rstrip()
            text.append(f'    {name}: {yaml_number(value)}  # standard error {error}')
        text.append('    model_response: sampled  # what was fitted has the hold in it')
        return '\n'.join(text) + '\n'

    def _scaled(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        return 2.0 * np.pi * frequency / self._reference_rad_per_s

    def _sampled(
        self, frequency_hz: ArrayLike,
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        return sampled_response(
            self._sections, self._scaled(frequency_hz),
            self.sample_period_s * self._reference_rad_per_s)


def fit_dynamics(
    measured: FrequencyResponse,
    *,
    structure: str = 'liu',
    numerator_order: int | None = None,
    denominator_order: int | None = None,
    delay_samples: float = 0.0,
    fit_delay: bool = False,
    maximum_frequency_hz: float = math.inf,
) -> DynamicsFit:
    """
    Fit a stable continuous-time model to a sampled frequency response.

    Linearised fits (Levy, reweighted after Sanathanan and Koerner) give the starts; then least
    squares is weighted by the variance of the points. Where the residual is larger than the noise,
    a model error is added to the variance, so that points of little noise do not dominate.

    Parameters
    ----------
    measured : FrequencyResponse
        The points, of the sampled response ``v[k] -> y[k]``.
    structure : str, optional
        ``'liu'`` for (6) in Liu 2015, or ``'rational'``.
    numerator_order, denominator_order : int, optional
        Orders of a rational model. The numerator has the smaller one: y[k] is measured before v[k]
        is applied and cannot depend on it.
    delay_samples : float, optional
        Known pure delay, in samples.
    fit_delay : bool, optional
        Fit a delay, which is then at least 0 and starts from `delay_samples`.
    maximum_frequency_hz : float, optional
        Points above it are ignored.

    Returns
    -------
    DynamicsFit
        The model, its parameters and their standard errors.

    Raises
    ------
    ValueError
        If the structure or its orders are not possible, or there are too few points.

    """
    shape = _shape(structure, numerator_order, denominator_order, fit_delay)
    if not (math.isfinite(delay_samples) and delay_samples >= 0.0):
        raise ValueError(f'delay_samples is {delay_samples}, it must be at least 0')
    points = measured.below(maximum_frequency_hz)
    if 2 * points.frequency_hz.size <= shape.size:
        raise ValueError(
            f'{points.frequency_hz.size} points up to {maximum_frequency_hz:g} Hz cannot '
            f'determine {shape.size} parameters; at least {shape.size // 2 + 1} are needed')
    problem = RationalProblem.of(shape, points, delay_samples, structure == 'liu')
    fit = fit_rational(problem)
    values, transform = _named(structure, fit.sections, shape, problem.reference)
    errors = np.sqrt(np.maximum(
        np.einsum('ip,pq,iq->i', transform, fit.covariance, transform), 0.0))
    return DynamicsFit(
        structure=structure,
        parameters=DynamicsParameters.from_mapping(values) if structure == 'liu' else None,
        values=values,
        standard_errors=dict(zip(values, errors.tolist(), strict=True)),
        delay_s=fit.sections.delay / problem.reference,
        sample_period_s=points.sample_period_s,
        reduced_chi_squared=fit.reduced_chi_squared,
        model_error=fit.model_error,
        frequency_range_hz=(float(points.frequency_hz[0]), float(points.frequency_hz[-1])),
        points=points.frequency_hz.size,
        _sections=fit.sections,
        _reference_rad_per_s=problem.reference,
        _covariance=fit.covariance)


def _shape(
    structure: str, numerator_order: int | None, denominator_order: int | None, fit_delay: bool,
) -> Shape:
    if structure not in STRUCTURES:
        raise ValueError(f'structure is {structure!r}, allowed are {", ".join(STRUCTURES)}')
    if structure == 'liu':
        if (numerator_order, denominator_order) != (None, None) or fit_delay:
            raise ValueError(
                "numerator_order, denominator_order and fit_delay belong to structure 'rational'; "
                "(6), 'liu', has 2, 5 and no delay to fit")
        return _LIU_SHAPE
    if numerator_order is None or denominator_order is None:
        raise ValueError("structure 'rational' needs numerator_order and denominator_order")
    if not 0 <= numerator_order < denominator_order <= 20:
        raise ValueError(
            f'numerator_order is {numerator_order} and denominator_order {denominator_order}, '
            'allowed is 0 <= numerator_order < denominator_order <= 20')
    return Shape(
        numerator_order, denominator_order % 2, denominator_order // 2, fit_delay)


def _named(
    structure: str, sections: Sections, shape: Shape, reference: float,
) -> tuple[dict[str, float], NDArray[np.float64]]:
    """Return named values and their derivatives by the parameter vector, shape (V, P)."""
    if structure == 'liu':
        return _named_liu(sections, reference)
    values: dict[str, float] = {}
    slopes: list[float] = []
    for name, logs, unit in (
        ('rate', sections.log_rate, reference),
        ('natural_frequency', sections.log_frequency, reference),
        ('damping_ratio', sections.log_damping, 1.0),
    ):
        for number, value in enumerate((np.exp(logs) * unit).tolist(), start=1):
            suffix = '_rad_per_s' if unit != 1.0 else ''
            values[f'{name}_{number}{suffix}'] = value
            slopes.append(value)
    for power, coefficient in enumerate(sections.numerator.tolist()):
        # Over a denominator of unit dc gain.
        values[f'numerator_s{power}'] = coefficient / reference**power
        slopes.append(1.0 / reference**power)
    if shape.fits_delay:
        values['delay_s'] = sections.delay / reference
        slopes.append(1.0 / reference)
    return values, np.diag(slopes)


def _named_liu(
    sections: Sections, reference: float,
) -> tuple[dict[str, float], NDArray[np.float64]]:
    """Return the parameters of (6), the slower pair first, and their derivatives."""
    first, second = np.argsort(sections.log_frequency).tolist()
    rate = math.exp(float(sections.log_rate[0])) * reference
    frequency = np.exp(sections.log_frequency) * reference
    damping = np.exp(sections.log_damping)
    n0, n1, n2 = sections.numerator.tolist()
    k = n2 / reference**2 * rate * float(np.prod(frequency**2))
    b1, b2 = n1 / n2 * reference, n0 / n2 * reference**2
    # Order of the vector: log rate, log frequencies (2), log dampings (2), n0, n1, n2.
    rows = {
        'gain_k_rad3_per_s3': (k, {0: k, 1: 2.0 * k, 2: 2.0 * k, 7: k / n2}),
        'zero_b1_rad_per_s': (b1, {6: reference / n2, 7: -b1 / n2}),
        'zero_b2_rad2_per_s2': (b2, {5: reference**2 / n2, 7: -b2 / n2}),
        'time_constant_s': (1.0 / rate, {0: -1.0 / rate}),
    }
    for number, place in ((1, first), (2, second)):
        zeta, omega = float(damping[place]), float(frequency[place])
        rows[f'damping_ratio_{number}'] = (zeta, {3 + place: zeta})
        rows[f'natural_frequency_{number}_rad_per_s'] = (omega, {1 + place: omega})
    transform = np.zeros((len(rows), 8))
    for row, (_, slopes) in enumerate(rows.values()):
        for column, slope in slopes.items():
            transform[row, column] = slope
    return {name: value for name, (value, _) in rows.items()}, transform
