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

"""Identified linear dynamics G(s): response, uncertainty, verdict, parameter file."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from piezo_ros.identification.dynamics.dynamics_file import Fact, dynamics_yaml
from piezo_ros.identification.dynamics.dynamics_validation import Validation, validate
from piezo_ros.identification.dynamics.named_parameters import section_lists
from piezo_ros.identification.dynamics.rational_fit import RationalFit
from piezo_ros.identification.dynamics.rational_model import (
    polynomials,
    response,
    sampled_response,
)
from piezo_ros.identification.dynamics.structure_choice import Candidate
from piezo_ros.identification.estimation.covariance import radius_95
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.model.dynamics import DynamicsParameters
from piezo_ros.model.parameters import constraint_of

if TYPE_CHECKING:
    import control

__all__ = ['DynamicsFit', 'as_sections']

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

        Returns
        -------
        ndarray of complex, shape (N,)
            The response, um/um.

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

        Returns
        -------
        ndarray of complex, shape (N,)
            The response, um/um.

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
                (name, value) for name, value in as_sections(self._fit).items() if value != [])
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


def as_sections(fit: RationalFit) -> dict[str, Fact]:
    """
    Return a model in the lists of ``dynamics: sections``, all behind the hysteresis.

    Parameters
    ----------
    fit : RationalFit
        The model.

    Raises
    ------
    ValueError
        If the dc gain is not positive.

    """
    return {
        'dynamics': 'sections', **section_lists(fit.sections, fit.problem.reference),
        'pairs_before_hysteresis': 0}
