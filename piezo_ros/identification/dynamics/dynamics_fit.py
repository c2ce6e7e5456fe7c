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
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from piezo_ros.identification.dynamics.dynamics_file import Fact, dynamics_yaml
from piezo_ros.identification.dynamics.named_parameters import (
    named_liu,
    named_rational,
    section_lists,
)
from piezo_ros.identification.dynamics.rational_fit import (
    FASTEST,
    RationalFit,
    RationalProblem,
    bootstrapped,
    fit_rational,
)
from piezo_ros.identification.dynamics.rational_model import (
    Shape,
    polynomials,
    response,
    sampled_response,
)
from piezo_ros.identification.dynamics.structure_choice import (
    LIU_SHAPE,
    Candidate,
    choose_structure,
    shape_of,
)
from piezo_ros.identification.dynamics.validation import Validation, validate
from piezo_ros.identification.estimation.covariance import radius_95
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.model.dynamics import DynamicsParameters
from piezo_ros.model.parameters import ParameterError, constraint_of

if TYPE_CHECKING:
    import control

__all__ = ['STRUCTURES', 'DynamicsFit', 'fit_dynamics']

STRUCTURES = ('liu', 'rational', 'auto')
_HIGHEST_ORDER = 20
_NORMAL_95 = 1.959964
_RIVAL = 6.0  # difference of the Bayesian criterion that is weak evidence
_MOST_CANDIDATES = 5  # that the file names


@dataclass(frozen=True)
class DynamicsFit:
    """
    Identified linear dynamics with their uncertainty.

    Attributes
    ----------
    structure : str
        ``'liu'`` for (6), else ``'rational'``; with ``structure='auto'`` what was chosen.
    parameters : DynamicsParameters or None
        The model for rig and nodes, the parameters of (6) or sections; None where these cannot
        express it, as of a model of negative dc gain.
    values, standard_errors : mapping of str to float
        Every fitted parameter by name and its standard error, from the residual of the points;
        infinite where the points do not determine the parameter, or it ended at a bound.
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
    candidates : tuple of Candidate
        With ``structure='auto'``, the structures that were compared, best first.

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
    candidates: tuple[Candidate, ...]
    _fit: RationalFit
    _measured: FrequencyResponse
    _delay_samples: float  # known

    @property
    def polynomials(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numerator and monic denominator of G(s), highest power of s first."""
        return polynomials(self._fit.sections, self._fit.problem.reference)

    @property
    def transfer_function(self) -> 'control.TransferFunction':
        """G(s) without the delay as a continuous-time ``control.TransferFunction``."""
        import control
        return control.tf(*self.polynomials, inputs='command_um', outputs='displacement_um')

    @property
    def orders(self) -> tuple[int, int]:
        """Orders of numerator and denominator."""
        shape = self._fit.problem.shape
        return shape.numerator_order, shape.denominator_order

    @cached_property
    def validation(self) -> Validation:
        """What the fit is worth, by points that were left out and by its residual."""
        return validate(
            self._fit, self._measured, self._delay_samples,
            radius=self.response_confidence_radius,
            structure=self.structure, rivals=self._rivals)

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the continuous G(i 2 pi f), with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies, hertz.

        """
        s = np.asarray(1j * self._scaled(frequency_hz), dtype=np.complex128)
        return response(self._fit.sections, s)[0]

    def sampled_response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """
        Return the response v[k] -> y[k] behind the zero-order hold, with the delay.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        """
        return self._sampled(frequency_hz)[0]

    def response_covariance(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Return the covariance of the sampled response, of its real and its imaginary part.

        It is that of the parameters, which is large in one direction and small in the other, and
        where the noise does not explain the residual that of the structure.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        Returns
        -------
        ndarray, shape (N, 2, 2)
            The covariances.

        """
        value, jacobian = self._sampled(frequency_hz)
        slopes = jacobian[:, :self._fit.problem.shape.size] @ self._fit.covariance.factor
        parts = np.stack([slopes.real, slopes.imag], axis=1)
        largest = float(np.abs(self._fit.problem.measured).max())
        structural = 0.5 * self.model_error**2 * np.abs(value) * largest
        return np.asarray(
            parts @ parts.swapaxes(1, 2) + structural[:, None, None] * np.eye(2))

    def response_standard_error(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Return the standard error of the sampled response, ``E|error|**2`` rooted, shape (N,).

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        """
        return np.asarray(np.sqrt(np.trace(
            self.response_covariance(frequency_hz), axis1=1, axis2=2)))

    def response_confidence_radius(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Return the radius about the sampled response that contains the true one in 95 % of cases.

        Parameters
        ----------
        frequency_hz : array_like, shape (N,)
            Frequencies below the Nyquist frequency, hertz.

        Returns
        -------
        ndarray, shape (N,)
            The radii, for each frequency alone.

        """
        return self._quantile / _NORMAL_95 * radius_95(self.response_covariance(frequency_hz))

    def confidence_interval(self, name: str) -> tuple[float, float]:
        """
        Return the bounds that contain the true parameter in 95 % of cases.

        Parameters
        ----------
        name : str
            A name in `values`.

        """
        half = self._quantile * self.standard_errors[name]
        return self.values[name] - half, self.values[name] + half

    def to_parameter_yaml(
        self, source: str, record: Mapping[str, Fact] | None = None,
    ) -> str:
        """
        Return a ROS parameter file for the trajectory node, with the facts of the identification.

        Parameters
        ----------
        source : str
            Origin of the record, for instance the name of the bag.
        record : mapping of str to value, optional
            Facts of the record: ``points_file``, the name of the file with the points,
            ``samples_used`` and the like.

        Raises
        ------
        ValueError
            If the dc gain is not positive.

        """
        notes = {}
        parameters: dict[str, Fact] = {}
        if self.structure == 'liu':
            title = 'Linear dynamics (6) identified by piezo_ros.'
            parameters.update(self.values)
            for name, error in self.standard_errors.items():
                unit = constraint_of(DynamicsParameters.__dataclass_fields__[name]).unit
                notes[name] = f'standard error {error:.3g} {unit}'.rstrip()
        else:
            title = 'Linear dynamics of orders {} {} identified by piezo_ros.'.format(*self.orders)
            parameters.update(
                (name, value) for name, value in _as_sections(self._fit).items() if value != [])
        if self.delay_s > 0.0:
            parameters['delay_s'] = self.delay_s
        parameters['hysteresis_place'] = 'undecided'
        notes['hysteresis_place'] = 'one response does not say which poles are before it'
        parameters['model_response'] = 'sampled'
        notes['model_response'] = 'what was fitted has the hold in it'
        return dynamics_yaml(
            parameters, {**self.facts, **(record or {})}, source=source, notes=notes,
            title=title)

    @property
    def facts(self) -> Mapping[str, Fact]:
        """What the identification found, for the file: flat names with units."""
        validation = self.validation
        low, high = self.frequency_range_hz
        facts: dict[str, Fact] = {
            'verdict': str(validation.verdict),
            'structure': self.structure,
            'numerator_order': self.orders[0],
            'denominator_order': self.orders[1],
            'points_used': self.points,
            'points_left_out': len(self._measured.excluded),
            'lowest_frequency_hz': low,
            'highest_frequency_hz': high,
            'usable_to_hz': validation.usable_to_hz,
            'fit_percent': validation.held_out_fit_percent,
            'reduced_chi_squared': self.reduced_chi_squared,
            'model_error': self.model_error,
            'residual_correlation': validation.residual_correlation,
            'largest_misfit_percent': validation.largest_misfit_percent,
            'largest_misfit_hz': validation.largest_misfit_hz,
            'sample_period_s': self.sample_period_s,
            'delay_s': self.delay_s,
        }
        if self.candidates:
            facts['candidates'] = '; '.join(
                f'{candidate.name}: {candidate.criterion:.1f}'
                for candidate in self.candidates[:_MOST_CANDIDATES])
        if self.structure != 'liu':
            facts.update((name, value) for name, value in self.values.items() if name != 'delay_s')
        facts.update(
            (f'{name}_standard_error', error) for name, error in self.standard_errors.items())
        return facts

    @property
    def _rivals(self) -> list[RationalFit] | None:
        """Other structures for which there is nearly as much evidence."""
        if not self.candidates:
            return None
        limit = _RIVAL + min(
            candidate.criterion for candidate in self.candidates if candidate.fit is self._fit)
        return [
            candidate.fit for candidate in self.candidates
            if candidate.fit is not self._fit and candidate.criterion < limit]

    @property
    def _quantile(self) -> float:
        """Of Student's distribution: the variance of the residual is an estimate too."""
        degrees = max(2 * self.points - self._fit.problem.shape.size, 1)
        return float(stdtrit(degrees, 0.975))

    def _scaled(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        return 2.0 * np.pi * frequency / self._fit.problem.reference

    def _sampled(
        self, frequency_hz: ArrayLike,
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        return sampled_response(
            self._fit.sections, self._scaled(frequency_hz),
            self.sample_period_s * self._fit.problem.reference)


def fit_dynamics(
    measured: FrequencyResponse,
    *,
    structure: str = 'liu',
    numerator_order: int | None = None,
    denominator_order: int | None = None,
    delay_samples: float = 0.0,
    fit_delay: bool = False,
    maximum_frequency_hz: float = math.inf,
    bootstrap: int = 0,
) -> DynamicsFit:
    """
    Fit a stable continuous-time model to a sampled frequency response.

    Linear problems (Levy's, reweighted after Sanathanan and Koerner, and vector fitting) give the
    starts; then least squares is weighted by the variance of the points. Where the residual is
    larger than the noise, a model error is added to the variance, so that points of little noise do
    not dominate.

    Parameters
    ----------
    measured : FrequencyResponse
        The points, of the sampled response ``v[k] -> y[k]``.
    structure : str, optional
        ``'liu'`` for (6) in Liu 2015, ``'rational'`` with given orders, or ``'auto'``: (6) where it
        explains the points as well as any model, else the smallest rational model that does.
    numerator_order, denominator_order : int, optional
        Orders of a rational model. The numerator has the smaller one: y[k] is measured before v[k]
        is applied and cannot depend on it.
    delay_samples : float, optional
        Known pure delay, in samples.
    fit_delay : bool, optional
        Fit a delay, which is then at least 0 and starts from `delay_samples`.
    maximum_frequency_hz : float, optional
        Points above it are ignored.
    bootstrap : int, optional
        Take the covariance from so many fits to points that are drawn anew about the model, in
        place of the linearised one; 0 for none.

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
    if bootstrap < 0 or bootstrap == 1:
        raise ValueError(f'bootstrap is {bootstrap}, allowed is 0 or at least 2')
    points = measured.below(maximum_frequency_hz)
    if 2 * points.frequency_hz.size <= shape.size:
        raise ValueError(
            f'{points.frequency_hz.size} points up to {maximum_frequency_hz:g} Hz cannot '
            f'determine {shape.size} parameters; at least {shape.size // 2 + 1} are needed')
    candidates: tuple[Candidate, ...] = ()
    if structure == 'auto':
        chosen, candidates = choose_structure(points, delay_samples)
        structure, fit = chosen.structure, chosen.fit
    elif structure == 'liu':
        fit = _fit_of_six(points, delay_samples)
    else:
        fit = fit_rational(RationalProblem.of(shape, points, delay_samples))
    if bootstrap:
        fit = bootstrapped(fit, bootstrap)
    problem = fit.problem
    if structure == 'liu':
        values, transform = named_liu(fit.sections, problem.reference)
    else:
        values, transform = named_rational(fit.sections, problem.shape, problem.reference)
    errors = fit.covariance.standard_errors(transform)
    errors[np.any(transform[:, fit.at_bound] != 0.0, axis=1)] = np.inf
    delay_s = fit.sections.delay / problem.reference
    return DynamicsFit(
        structure=structure,
        parameters=_parameters(structure, fit, values, delay_s),
        values=values,
        standard_errors=dict(zip(values, errors.tolist(), strict=True)),
        delay_s=delay_s,
        sample_period_s=points.sample_period_s,
        reduced_chi_squared=fit.reduced_chi_squared,
        model_error=fit.model_error,
        frequency_range_hz=(float(points.frequency_hz[0]), float(points.frequency_hz[-1])),
        points=points.frequency_hz.size,
        candidates=candidates,
        _fit=fit,
        _measured=points,
        _delay_samples=delay_samples)


def _as_sections(fit: RationalFit) -> dict[str, Fact]:
    """Return a model in the lists of ``dynamics: sections``, all behind the hysteresis."""
    return {
        'dynamics': 'sections', **section_lists(fit.sections, fit.problem.reference),
        'pairs_before_hysteresis': 0}


def _parameters(
    structure: str, fit: RationalFit, values: Mapping[str, float], delay_s: float,
) -> DynamicsParameters | None:
    common = {'delay_s': delay_s, 'hysteresis_place': 'undecided'}
    if structure == 'liu':
        return DynamicsParameters.from_mapping({**values, **common})
    try:
        return DynamicsParameters.from_mapping({**_as_sections(fit), **common})
    except ValueError:
        return None


def _fit_of_six(points: FrequencyResponse, delay_samples: float) -> RationalFit:
    """Fit (6) with parameters in the ranges that the nodes take."""
    for fastest in (FASTEST, 1e-1 * FASTEST, 1e-2 * FASTEST, 1e-3 * FASTEST):
        fit = fit_rational(RationalProblem.of(
            LIU_SHAPE, points, delay_samples, positive=True, fastest=fastest))
        try:
            DynamicsParameters.from_mapping(named_liu(fit.sections, fit.problem.reference)[0])
        except ParameterError as error:
            refused = error
            continue
        return fit
    raise ValueError(f'(6) does not suit these points: {refused}')


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
        return LIU_SHAPE
    if structure == 'auto':
        if (numerator_order, denominator_order) != (None, None) or fit_delay:
            raise ValueError(
                "numerator_order, denominator_order and fit_delay belong to structure 'rational'; "
                "'auto' chooses them")
        return shape_of(0, 1)
    if numerator_order is None or denominator_order is None:
        raise ValueError("structure 'rational' needs numerator_order and denominator_order")
    if not 0 <= numerator_order < denominator_order <= _HIGHEST_ORDER:
        raise ValueError(
            f'numerator_order is {numerator_order} and denominator_order {denominator_order}, '
            'allowed is 0 <= numerator_order < denominator_order <= '
            f'{_HIGHEST_ORDER}')
    return shape_of(numerator_order, denominator_order, fit_delay)
