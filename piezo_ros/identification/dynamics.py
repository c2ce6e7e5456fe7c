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
Fit of the linear dynamics, (6) in Liu 2015 or any stable rational function, to a response.

What is fitted is the model sampled behind a zero-order hold, because that is what a record of
v[k] -> y[k] shows: at 100 kHz the hold alone is 2.5 % at 800 Hz. The result is the continuous G(s).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, least_squares

from piezo_ros.identification.frequency_response import FrequencyResponse
from piezo_ros.identification.rational import (
    Sections,
    Shape,
    polynomials,
    response,
    sampled_response,
    start_from_response,
    with_best_numerator,
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
_FASTEST = 10.0  # over the highest measured frequency: nothing beyond can be seen
_DAMPING = (1e-4, 1e2)
_EVALUATIONS = 100
_STARTS = 4  # of which the best is taken
_MODEL_ERROR_ROUNDS = 4


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
        Every fitted parameter by name and its standard error (from noise and, where points scatter
        by more than noise, from that).
    delay_s : float
        Pure delay, known and fitted together; not part of `transfer_function`.
    sample_period_s : float
        Sample period of the record, seconds.
    reduced_chi_squared : float
        Squared residual over what noise explains; far above 1 the structure is not quite right.
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
        Return the bounds that hold the true parameter in 95 % of cases.

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
            Where the record comes from, for instance the bag's name.

        Raises
        ------
        ValueError
            If the structure is not (6): the node knows no other.

        """
        if self.parameters is None:
            raise ValueError(
                f'structure {self.structure!r} has no parameter file: the trajectory node knows '
                "'liu', (6), only")
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
        for name, value in self.parameters.to_mapping().items():
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

    A linearised fit (Levy, reweighted after Sanathanan and Koerner) gives the start, least squares
    weighted by the confidence of the points the result. Where the points scatter by more than
    their noise, a model error is added to it, so that no point outweighs all others.

    Parameters
    ----------
    measured : FrequencyResponse
        The points, of the sampled response ``v[k] -> y[k]``.
    structure : str, optional
        ``'liu'`` for (6) in Liu 2015, or ``'rational'``.
    numerator_order, denominator_order : int, optional
        Orders of a rational model; the numerator's is the smaller one, for a voltage that is
        applied after the measurement cannot show in it.
    delay_samples : float, optional
        Known pure delay, in samples.
    fit_delay : bool, optional
        Fit a delay, which is then at least 0 and starts from `delay_samples`.
    maximum_frequency_hz : float, optional
        Points above are ignored.

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
    problem = _Problem.of(shape, points, delay_samples, structure == 'liu')
    sections, jacobian, chi_squared, model_error = _solve(problem)
    # Scaled by what is left over: the variances of the points are estimates themselves.
    degrees = 2 * points.frequency_hz.size - shape.size
    residual = problem.residual(sections, model_error)
    scale = float(residual @ residual) / degrees
    covariance = np.asarray(
        scale * np.linalg.pinv(jacobian.T @ jacobian, hermitian=True, rcond=1e-14))
    values, transform = _named(structure, sections, shape, problem.reference)
    errors = np.sqrt(np.maximum(
        np.einsum('ip,pq,iq->i', transform, covariance, transform), 0.0))
    return DynamicsFit(
        structure=structure,
        parameters=DynamicsParameters.from_mapping(values) if structure == 'liu' else None,
        values=values,
        standard_errors=dict(zip(values, errors.tolist(), strict=True)),
        delay_s=sections.delay / problem.reference,
        sample_period_s=points.sample_period_s,
        reduced_chi_squared=chi_squared,
        model_error=model_error,
        frequency_range_hz=(float(points.frequency_hz[0]), float(points.frequency_hz[-1])),
        points=points.frequency_hz.size,
        _sections=sections,
        _reference_rad_per_s=problem.reference,
        _covariance=covariance)


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


class _Problem(NamedTuple):
    """The points in units of the reference frequency, and the bounds of the parameters."""

    shape: Shape
    frequency: NDArray[np.float64]  # (N,) angular
    measured: NDArray[np.complex128]  # (N,)
    variance: NDArray[np.float64]  # (N,) of the noise
    sample_period: float
    delay: float  # known
    reference: float  # rad/s, the highest frequency
    lower: NDArray[np.float64]  # (P,)
    upper: NDArray[np.float64]  # (P,)

    @classmethod
    def of(
        cls, shape: Shape, points: FrequencyResponse, delay_samples: float, positive: bool,
    ) -> '_Problem':
        omega = 2.0 * np.pi * points.frequency_hz
        reference = float(omega.max())
        period = points.sample_period_s * reference
        slowest = math.log(1e-2 * float(omega.min()) / reference)
        sections = shape.first_order + shape.second_order
        numerator: NDArray[np.float64] = np.full(shape.numerator_order + 1, np.inf)
        low_numerator: NDArray[np.float64] = -numerator
        if positive:  # (6) has k > 0 and b2 > 0, and its zeros are no faster than its poles
            gain = float(np.abs(points.response).max())
            numerator = gain * np.array([1e3, 1e2, 1e4])
            low_numerator = gain * np.array([1e-3, -1e2, _FASTEST**-2])
        lower = np.concatenate([
            np.full(sections, slowest), np.full(shape.second_order, math.log(_DAMPING[0])),
            low_numerator, np.full(int(shape.fits_delay), -delay_samples * period)])
        upper = np.concatenate([
            np.full(sections, math.log(_FASTEST)),
            np.full(shape.second_order, math.log(_DAMPING[1])),
            numerator, np.full(int(shape.fits_delay), np.inf)])
        return cls(
            shape, omega / reference, points.response, points.variance, period,
            delay_samples * period, reference, lower, upper)

    @property
    def power(self) -> NDArray[np.float64]:
        """
        What a model error counts in: between relative (|G|) and absolute (the largest |G|).

        Relative error alone would give up the pass band for dips of the response.
        """
        gain = np.abs(self.measured)
        return np.asarray(gain * gain.max())

    def weight(self, model_error: float) -> NDArray[np.float64]:
        """Return inverse standard errors of the real and of the imaginary parts, shape (N,)."""
        variance = self.variance + model_error**2 * self.power
        return np.asarray(1.0 / np.sqrt(0.5 * variance))

    def residual(self, sections: Sections, model_error: float) -> NDArray[np.float64]:
        """Return weighted real, then imaginary residuals, shape (2 N,)."""
        value, _ = sampled_response(sections, self.frequency, self.sample_period)
        error = self.weight(model_error) * (value - self.measured)
        return np.concatenate([error.real, error.imag])

    def refine(self, start: Sections, model_error: float) -> '_Refined':
        """Return the local optimum from a start."""
        weight = self.weight(model_error)
        cache: dict[bytes, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

        def evaluate(vector: NDArray[np.float64]) -> tuple[
                NDArray[np.float64], NDArray[np.float64]]:
            key = vector.tobytes()
            if key not in cache:
                value, jacobian = sampled_response(
                    Sections.split(self.shape, vector, self.delay), self.frequency,
                    self.sample_period)
                error = weight * (value - self.measured)
                slope = weight[:, None] * jacobian[:, :self.shape.size]
                cache.clear()
                cache[key] = (
                    np.concatenate([error.real, error.imag]),
                    np.concatenate([slope.real, slope.imag]))
            return cache[key]

        def residual(vector: NDArray[np.float64]) -> NDArray[np.float64]:
            return evaluate(vector)[0]

        def slopes(vector: NDArray[np.float64]) -> NDArray[np.float64]:
            return evaluate(vector)[1]

        vector = start.join(self.shape)
        if self.shape.fits_delay:
            vector[-1] = start.delay - self.delay
        inside = np.clip(vector, self.lower, self.upper)
        found = least_squares(
            residual, inside, jac=slopes,
            bounds=(self.lower, self.upper), x_scale='jac', max_nfev=_EVALUATIONS,
            xtol=1e-10, ftol=1e-10, gtol=1e-10)
        return _Refined(
            Sections.split(self.shape, found.x, self.delay), slopes(found.x),
            2.0 * float(found.cost))


class _Refined(NamedTuple):
    sections: Sections
    jacobian: NDArray[np.float64]  # (2 N, P), weighted
    squares: float


def _solve(problem: _Problem) -> tuple[Sections, NDArray[np.float64], float, float]:
    """Return the optimum, its weighted Jacobian, the reduced chi squared and the model error."""
    degrees = 2 * problem.frequency.size - problem.shape.size
    # What chi squared exceeds in one of a thousand cases of noise alone.
    enough = 1.0 + 3.1 * math.sqrt(2.0 / degrees)
    best: _Refined | None = None
    for start in _starts(problem):
        refined = problem.refine(start, 0.0)
        # Two starts that meet have found the optimum, and noise alone leaves nothing to look for.
        met = best is not None and abs(refined.squares - best.squares) < 1e-4 * best.squares
        if best is None or refined.squares < best.squares:
            best = refined
        if met or best.squares <= enough * degrees:
            break
    assert best is not None
    chi_squared = best.squares / degrees
    model_error = 0.0
    if chi_squared > enough:
        for _ in range(_MODEL_ERROR_ROUNDS):
            before, model_error = model_error, _model_error(problem, best.sections, degrees)
            best = problem.refine(best.sections, model_error)
            if abs(model_error - before) < 1e-2 * model_error:
                break
    return best.sections, best.jacobian, chi_squared, model_error


def _model_error(problem: _Problem, sections: Sections, degrees: int) -> float:
    """Return the model error that, added to the noise, explains the residual."""
    value, _ = sampled_response(sections, problem.frequency, problem.sample_period)
    squares = 2.0 * np.abs(value - problem.measured)**2

    def excess(log_error: float) -> float:
        return float(np.sum(
            squares / (problem.variance + math.exp(2.0 * log_error) * problem.power))) - degrees

    low, high = math.log(1e-12), math.log(1e3)
    if excess(low) <= 0.0:
        return 0.0
    return math.exp(float(brentq(excess, low, high, xtol=1e-3)))


def _starts(problem: _Problem) -> list[Sections]:
    """Return starts in the order in which to try them: linearised fits, then spread poles."""
    shape, omega = problem.shape, problem.frequency
    delays = [problem.delay]
    if shape.fits_delay:
        delays += [problem.delay + turn for turn in (0.25, 0.5, 1.0, 2.0, 4.0)]
    hold = -np.expm1(-1j * omega * problem.sample_period) / (1j * omega * problem.sample_period)
    starts = []
    for delay in delays:
        continuous = problem.measured / hold * np.exp(1j * omega * delay)
        terms = np.asarray(
            (1j * omega)[:, None]**np.arange(shape.numerator_order + 1), dtype=np.complex128)
        # Weighted by the noise, and evenly: points of little noise may not be all that counts.
        for weight in (problem.weight(0.0), 1.0 / np.abs(problem.measured)):
            linear = start_from_response(shape, omega, continuous, weight)
            starts.append(linear._replace(delay=delay))
        for top in (1.0, 3.0):
            count = shape.first_order + shape.second_order
            corner = top * np.geomspace(0.2, 1.0, count)
            spread = Sections(
                np.log(corner[:shape.first_order]), np.log(corner[shape.first_order:]),
                np.full(shape.second_order, math.log(0.3)), np.ones(1), 0.0)
            starts.append(with_best_numerator(
                spread, terms, omega, continuous, problem.weight(0.0))._replace(delay=delay))
    squares = [
        float(np.sum(problem.residual(start, 0.0)**2)) for start in starts]
    order = np.argsort([value if math.isfinite(value) else math.inf for value in squares])
    return [starts[i] for i in order[:_STARTS]]


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
