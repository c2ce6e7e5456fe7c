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
A rational model fitted to a sampled frequency response by weighted least squares.

    minimise sum_k |H(w_k) - H_k|^2 / (variance_k/2 + (e^2/2) |H_k| max |H_k|)

over the parameters of `rational_model`, H(w) being the response of the model behind the zero-order
hold and H_k the measured points. The model error e is 0 where the noise explains the residual; else
it is the value for which the weighted sum of squares equals the degrees of freedom. With v_k the
variance of point k, model error included, models are compared by the Bayesian criterion

    BIC = 2 sum_k (log v_k + |H(w_k) - H_k|^2/v_k) + P log(2 N)
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares

from piezo_ros.identification.dynamics.linear_starts import linear_starts
from piezo_ros.identification.dynamics.rational_model import Sections, Shape, sampled_response
from piezo_ros.identification.estimation.covariance import Covariance
from piezo_ros.identification.response.frequency_response import FrequencyResponse

__all__ = [
    'COARSE', 'FASTEST', 'Effort', 'RationalFit', 'RationalProblem', 'bootstrapped', 'fit_rational']

FASTEST = 1e4  # over the highest measured frequency: such poles and zeros do not show in the points
_DAMPING = (1e-4, 1e2)
_AT_BOUND = 1e-3  # distance, of a logarithm or relative
_NO_DELAY = 1e-9  # over the inverse highest frequency: the search ends beside its bound
_MODEL_ERROR_ROUNDS = 4


class Effort(NamedTuple):
    """How far a fit is carried."""

    starts: int  # of which the best is taken
    evaluations: int
    tolerance: float  # relative change of the squares that ends a search


THOROUGH = Effort(starts=4, evaluations=100, tolerance=1e-10)
COARSE = Effort(starts=2, evaluations=40, tolerance=1e-5)


class RationalProblem(NamedTuple):
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
        cls, shape: Shape, points: FrequencyResponse, delay_samples: float = 0.0, *,
        positive: bool = False, fastest: float = FASTEST, least_delay_samples: float = 0.0,
    ) -> 'RationalProblem':
        """
        Scale the points and set the bounds.

        Parameters
        ----------
        shape : Shape
            Orders of the model.
        points : FrequencyResponse
            Points of the sampled response.
        delay_samples : float, optional
            Known delay, in samples.
        positive : bool, optional
            Whether gain and zeros are bounded as those of (6) in Liu 2015.
        fastest : float, optional
            Bound of the poles over the highest frequency.
        least_delay_samples : float, optional
            Bound of the whole delay, in samples, where a delay is fitted.

        """
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
            low_numerator = gain * np.array([1e-3, -1e2, fastest**-2])
        lower = np.concatenate([
            np.full(sections, slowest), np.full(shape.second_order, math.log(_DAMPING[0])),
            low_numerator, np.full(
                int(shape.fits_delay), (least_delay_samples - delay_samples) * period)])
        upper = np.concatenate([
            np.full(sections, math.log(fastest)),
            np.full(shape.second_order, math.log(_DAMPING[1])),
            numerator, np.full(int(shape.fits_delay), np.inf)])
        return cls(
            shape, omega / reference, points.response, points.variance, period,
            delay_samples * period, reference, lower, upper)

    def seeing(self, points: FrequencyResponse) -> 'RationalProblem':
        """Return the same problem with other points, in the same units."""
        return self._replace(
            frequency=2.0 * np.pi * points.frequency_hz / self.reference,
            measured=points.response, variance=points.variance)

    @property
    def power(self) -> NDArray[np.float64]:
        """
        The square to which a model error refers: |H| max |H|, shape (N,).

        A purely relative error would fit the dips of the response at the cost of the pass band.
        """
        gain = np.abs(self.measured)
        return np.asarray(gain * gain.max())

    def without_hold(self, delay: float) -> NDArray[np.complex128]:
        """Return the points without hold and a delay: nearly G, below the Nyquist frequency."""
        turn = 1j * self.frequency * self.sample_period
        return np.asarray(
            self.measured * (turn / -np.expm1(-turn)) * np.exp(1j * self.frequency * delay))

    def weight(self, model_error: float) -> NDArray[np.float64]:
        """Return inverse standard errors of the real and of the imaginary parts, shape (N,)."""
        variance = self.variance + model_error**2 * self.power
        return np.asarray(1.0 / np.sqrt(0.5 * variance))

    def residual(self, sections: Sections, model_error: float) -> NDArray[np.float64]:
        """Return weighted real, then imaginary residuals, shape (2 N,)."""
        value, _ = sampled_response(sections, self.frequency, self.sample_period)
        error = self.weight(model_error) * (value - self.measured)
        return np.concatenate([error.real, error.imag])

    def refine(
        self, start: Sections, model_error: float, effort: 'Effort | None' = None,
    ) -> '_LocalOptimum':
        """Return the local optimum from a start."""
        effort = effort or THOROUGH
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
            bounds=(self.lower, self.upper), x_scale='jac', max_nfev=effort.evaluations,
            xtol=effort.tolerance, ftol=effort.tolerance, gtol=1e-10)
        if self.shape.fits_delay and found.x[-1] - self.lower[-1] < _NO_DELAY:
            found.x[-1] = self.lower[-1]
        return _LocalOptimum(
            Sections.split(self.shape, found.x, self.delay), found.x, slopes(found.x),
            2.0 * float(found.cost))


class _LocalOptimum(NamedTuple):
    """Where least squares ended from one start."""

    sections: Sections
    vector: NDArray[np.float64]  # (P,)
    jacobian: NDArray[np.float64]  # (2 N, P), weighted
    squares: float


class RationalFit(NamedTuple):
    """
    The best model of a shape with P parameters.

    Attributes
    ----------
    problem : RationalProblem
        What was fitted.
    sections : Sections
        The model.
    covariance : Covariance
        Of the parameter vector, scaled by the residual that is left.
    at_bound : ndarray of bool, shape (P,)
        Parameters that ended at a bound: their values are not estimates.
    reduced_chi_squared : float
        Squared residual over that of the noise.
    model_error : float
        Error of the structure, added to the noise in the weights.

    """

    problem: RationalProblem
    sections: Sections
    covariance: Covariance
    at_bound: NDArray[np.bool_]
    reduced_chi_squared: float
    model_error: float

    @property
    def explains(self) -> bool:
        """Whether the noise of the points explains the residual."""
        return self.model_error == 0.0

    def bayesian_criterion(self, least_error: float = 0.0) -> float:
        """
        Return BIC, of which the smallest is best; see the top of this module.

        Parameters
        ----------
        least_error : float, optional
            Model error that no structure is believed to fall below.

        """
        problem = self.problem
        return (self.deviance(problem, least_error)
                + problem.shape.size * math.log(2 * problem.frequency.size))

    def deviance(self, points: RationalProblem, least_error: float = 0.0) -> float:
        """
        Return -2 log of the likelihood of points, by this model and its error.

        Parameters
        ----------
        points : RationalProblem
            The points, in the units of `problem`; not necessarily those that were fitted.
        least_error : float, optional
            As for `bayesian_criterion`.

        """
        value, _ = sampled_response(self.sections, points.frequency, points.sample_period)
        variance = points.variance + max(self.model_error, least_error)**2 * points.power
        return float(2.0 * np.sum(
            np.log(variance) + np.abs(value - points.measured)**2 / variance))


def fit_rational(
    problem: RationalProblem, starts: Sequence[Sections] = (), effort: Effort = THOROUGH,
) -> RationalFit:
    """
    Return the best model of several starts.

    Parameters
    ----------
    problem : RationalProblem
        Points and bounds.
    starts : sequence of Sections, optional
        Models of this shape to start from, before those of the linear problems.
    effort : Effort, optional
        Less than the default to compare orders.

    Returns
    -------
    RationalFit
        The model with the covariance of its parameters.

    """
    degrees = max(2 * problem.frequency.size - problem.shape.size, 1)
    # Noise alone exceeds this chi squared in one of a thousand cases.
    enough = 1.0 + 3.1 * math.sqrt(2.0 / degrees)
    best: _LocalOptimum | None = None
    for start in itertools.chain(starts, _best_starts(problem, effort.starts)):
        refined = problem.refine(start, 0.0, effort)
        # Two starts with the same result have found the optimum, and noise alone cannot be reduced.
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
            best = problem.refine(best.sections, model_error, effort)
            if abs(model_error - before) < 1e-2 * model_error:
                break
    return RationalFit(
        problem, best.sections,
        # Scaled by the residual: the variances of the points are themselves estimates.
        Covariance.of(best.jacobian, best.squares / degrees),
        _at_bound(problem, best.vector), chi_squared, model_error)


def bootstrapped(fit: RationalFit, resamples: int) -> RationalFit:
    """
    Return the same fit with the covariance of fits to points that are drawn about its model.

    Parameters
    ----------
    fit : RationalFit
        The fit.
    resamples : int
        Number of further fits, at least 2.

    """
    problem = fit.problem
    value, _ = sampled_response(fit.sections, problem.frequency, problem.sample_period)
    degrees = max(2 * problem.frequency.size - problem.shape.size, 1)
    residual = problem.residual(fit.sections, fit.model_error)
    size = math.sqrt(float(residual @ residual) / degrees) / problem.weight(fit.model_error)
    generator = np.random.default_rng(0)  # the same points give the same errors
    vectors = []
    for _ in range(resamples):
        noise = generator.normal(size=value.size) + 1j * generator.normal(size=value.size)
        drawn = problem._replace(measured=value + size * noise)
        vectors.append(drawn.refine(fit.sections, fit.model_error).vector)
    return fit._replace(covariance=Covariance.of_sample(np.array(vectors)))


def _at_bound(
    problem: RationalProblem, vector: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return which parameters are at a bound; a delay of none is no bound but an estimate."""
    logarithms = problem.shape.first_order + 2 * problem.shape.second_order
    reach = np.where(
        np.arange(vector.size) < logarithms, _AT_BOUND, _AT_BOUND * np.abs(vector))
    near = (vector - problem.lower < reach) | (problem.upper - vector < reach)
    if problem.shape.fits_delay:
        near[-1] = False
    return np.asarray(near)


def _model_error(problem: RationalProblem, sections: Sections, degrees: int) -> float:
    """Return the model error for which the weighted squares equal the degrees of freedom."""
    value, _ = sampled_response(sections, problem.frequency, problem.sample_period)
    squares = 2.0 * np.abs(value - problem.measured)**2

    def excess(log_error: float) -> float:
        return float(np.sum(
            squares / (problem.variance + math.exp(2.0 * log_error) * problem.power))) - degrees

    low, high = math.log(1e-12), math.log(1e3)
    if excess(low) <= 0.0:
        return 0.0
    return math.exp(float(brentq(excess, low, high, xtol=1e-3)))


def _best_starts(problem: RationalProblem, most: int) -> Iterator[Sections]:
    """Yield the starts of least residual, best first, once they are asked for."""
    shape, omega = problem.shape, problem.frequency
    delays = [problem.delay]
    if shape.fits_delay:
        delays += [problem.delay + turn for turn in (0.5, 1.5, 4.0)]
    starts = [
        start._replace(delay=delay) for delay in delays
        for start in linear_starts(
            shape, omega, problem.without_hold(delay), problem.weight(0.0))]
    squares = [
        float(np.sum(problem.residual(start, 0.0)**2)) for start in starts]
    order = np.argsort([value if math.isfinite(value) else math.inf for value in squares])
    for place in order[:most]:
        yield starts[place]
