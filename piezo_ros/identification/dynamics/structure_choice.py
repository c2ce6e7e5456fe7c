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
The structure of a model chosen by its points: orders, a delay or none, (6) or a smaller model.

Orders grow as long as the Bayesian criterion of `rational_fit` falls; then zeros, poles and the
delay are taken away one by one as long as it falls further. A narrow resonance that rests on no
more than the two points beside it is refused. Models of nearly the same criterion are compared on
points that their fits have not seen (`held_out`), and of equals the smallest is taken. (6) in Liu
2015 is taken where it explains the points as well as the best one and they determine it.
"""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.dynamics.linear_starts import with_a_pole_more
from piezo_ros.identification.dynamics.named_parameters import parameter_names
from piezo_ros.identification.dynamics.rational_fit import (
    COARSE,
    RationalFit,
    RationalProblem,
    fit_rational,
)
from piezo_ros.identification.dynamics.rational_model import Sections, Shape, sampled_response
from piezo_ros.identification.response.frequency_response import FrequencyResponse

__all__ = [
    'STAGE_ERROR', 'LIU_SHAPE', 'Candidate', 'HeldOut', 'choose_structure', 'held_out', 'shape_of',
    'smallest_as_good', 'too_fast', 'undetermined']

LIU_SHAPE = Shape(numerator_order=2, first_order=1, second_order=2)
_HIGHEST_ORDER = 10
_PATIENCE = 2  # orders without improvement, after which the search for higher ones ends
_SMALL_ERROR = 0.01  # of a model, above which higher orders are tried in any case
_NEARLY = 10.0  # difference of the criterion that is strong evidence
_DETERMINED = 0.5  # standard error of a logarithm, up to which a pole counts as determined
_FAR = 10.0  # over the highest measured frequency: such poles may be out of sight
_SAME = 0.01  # relative difference of two models that are equally good where both are large
_LEAST_ERROR = 1e-3  # no order is added for what the stage does in less than this of its response
_UNEXPLAINED = 10.0  # reduced chi squared of the best model, above which the stage is not linear
STAGE_ERROR = 5e-3  # no order is then added for less than this of its response
_EQUAL = 4.0  # difference of the deviance of unseen points that is no evidence
_FOLDS = (2, 3, 5)


class Candidate(NamedTuple):
    """A structure that was considered, and its evidence."""

    structure: str  # 'liu' or 'rational'
    fit: RationalFit

    @property
    def criterion(self) -> float:
        """Bayesian criterion, in which no structure is better than a thousandth."""
        return _criterion(self.fit)

    @property
    def name(self) -> str:
        """Orders of numerator and denominator, in words."""
        shape = self.fit.problem.shape
        if self.structure == 'liu':
            return '(6)'
        return (f'{shape.numerator_order}/{shape.denominator_order}'
                + (' with delay' if shape.fits_delay else ''))


class HeldOut(NamedTuple):
    """Every point predicted by a fit that has not seen it."""

    predicted: NDArray[np.complex128]  # (N,)
    deviance: float

    def fit_percent(self, measured: NDArray[np.complex128]) -> float:
        """Return 100 (1 - ||y - yhat||/||y - mean||) of the points."""
        spread = float(np.linalg.norm(measured - measured.mean()))
        missed = float(np.linalg.norm(measured - self.predicted))
        return 100.0 * (1.0 - missed / spread) if spread > 0.0 else -math.inf


def shape_of(numerator_order: int, denominator_order: int, fits_delay: bool = False) -> Shape:
    """Return the shape of a rational model; pairs may have real poles."""
    return Shape(
        numerator_order, denominator_order % 2, denominator_order // 2, fits_delay)


def held_out(
    shape: Shape, points: FrequencyResponse, delay_samples: float, *, positive: bool = False,
) -> HeldOut | None:
    """
    Predict every point by a fit to the others: interleaved parts, each left out once.

    Parameters
    ----------
    shape, points, delay_samples, positive
        As for `RationalProblem.of`.

    Returns
    -------
    HeldOut or None
        None if there are too few points.

    """
    distinct, number = np.unique(points.frequency_hz, return_inverse=True)
    for folds in _FOLDS:
        # As many numbers as parameters twice over; the lowest and highest point remain.
        if 2 * (distinct.size * (folds - 1)) // folds >= 2 * shape.size:
            break
    else:
        return None
    predicted = np.zeros(points.frequency_hz.size, dtype=np.complex128)
    deviance = 0.0
    for fold in range(folds):
        left_out = number % folds == fold
        fitted = fit_rational(RationalProblem.of(
            shape, points.select(~left_out), delay_samples, positive=positive), effort=COARSE)
        tested = fitted.problem.seeing(points.select(left_out))
        predicted[left_out] = sampled_response(
            fitted.sections, tested.frequency, tested.sample_period)[0]
        deviance += fitted.deviance(tested)
    return HeldOut(predicted, deviance)


def choose_structure(
    points: FrequencyResponse, delay_samples: float = 0.0,
) -> tuple[Candidate, tuple[Candidate, ...]]:
    """
    Return the smallest model that explains the points as well as a larger one.

    Parameters
    ----------
    points : FrequencyResponse
        The points, at least two.
    delay_samples : float, optional
        Known delay, in samples.

    Returns
    -------
    chosen : Candidate
        The model.
    considered : tuple of Candidate
        Those with which it was compared, best first.

    """
    search = _Search(points, delay_samples)
    best = min(
        (search.thinned(search.grow(fits_delay)) for fits_delay in (False, True)), key=_criterion)
    best = search.without_phantoms(best)
    best = search.smallest_of_equals(best)
    best = search.finished(search.plausible(best))
    chosen = Candidate('rational', best)
    considered = [Candidate('rational', fit) for fit in search.fits.values()]
    of_six = search.of_six()
    if of_six is not None:
        considered.append(Candidate('liu', of_six))
        if _serves_as_well(of_six, best):
            chosen = considered[-1]
    considered.sort(key=lambda candidate: candidate.criterion)
    return chosen, tuple(considered)


def smallest_as_good(
    fit: RationalFit, points: FrequencyResponse, delay_samples: float,
) -> RationalFit:
    """
    Return a model with less zeros and poles than a given one, if its criterion is better.

    Parameters
    ----------
    fit : RationalFit
        The model.
    points, delay_samples
        What it was fitted to.

    Returns
    -------
    RationalFit
        The smaller model, or the given one.

    """
    search = _Search(points, delay_samples)
    shape = fit.problem.shape
    # With bounds of its own, (6) is not the best of its shape.
    search.fits[shape] = fit
    return search.thinned(fit)


def _serves_as_well(of_six: RationalFit, best: RationalFit) -> bool:
    """Return whether (6) explains the points as the best model does, and they determine it."""
    if of_six.at_bound.any() or undetermined(of_six) or too_fast(of_six):
        return False
    # Of two that explain the points as well the smaller one is taken, and (6) of equals.
    problem = of_six.problem
    is_no_larger = problem.shape.size <= best.problem.shape.size
    nearly = _NEARLY if is_no_larger else 0.0
    if (of_six.bayesian_criterion() <= best.bayesian_criterion() + nearly
            or _criterion(of_six) <= _criterion(best) + nearly):
        return True
    # What a larger model explains beyond may be too little to be worth its poles.
    values = [
        sampled_response(fit.sections, problem.frequency, problem.sample_period)[0]
        for fit in (of_six, best)]
    apart = float(np.max(np.abs(values[0] - values[1]) / np.sqrt(problem.power)))
    return is_no_larger and apart < _SAME


def undetermined(fit: RationalFit) -> list[str]:
    """Return the poles and damping ratios that the points do not determine, by name."""
    names = parameter_names(fit.problem.shape)
    errors = fit.covariance.standard_errors(np.eye(fit.problem.shape.size))
    distant = too_fast(fit)
    return [
        name for name, error, is_at_bound in zip(names, errors, fit.at_bound, strict=False)
        if (error > _DETERMINED or is_at_bound) and name not in distant]


def too_fast(fit: RationalFit) -> list[str]:
    """Return the poles so far above the points that these only say that they are fast, by name."""
    corners = np.exp([*fit.sections.log_rate, *fit.sections.log_frequency])
    names = parameter_names(fit.problem.shape)
    errors = fit.covariance.standard_errors(np.eye(fit.problem.shape.size))
    found = []
    for place in np.flatnonzero(corners > _FAR).tolist():
        if errors[place] > _DETERMINED or fit.at_bound[place]:
            found.append(names[place])
            if place >= fit.problem.shape.first_order:
                found.append(names[place + fit.problem.shape.second_order])
    return found


class _Search:
    """The fits of one set of points, each made once."""

    def __init__(self, points: FrequencyResponse, delay_samples: float) -> None:
        self._points = points
        self._delay_samples = delay_samples
        self.fits: dict[Shape, RationalFit] = {}

    def fit(self, shape: Shape, starts: Iterable[Sections] = ()) -> RationalFit:
        """Return the fit of a shape."""
        if shape not in self.fits:
            self.fits[shape] = fit_rational(
                RationalProblem.of(shape, self._points, self._delay_samples), tuple(starts),
                COARSE)
        return self.fits[shape]

    def finished(self, fit: RationalFit) -> RationalFit:
        """Return a fit carried to its optimum, which takes the place of the coarse one."""
        finished = fit_rational(fit.problem, [fit.sections])
        self.fits[fit.problem.shape] = finished
        return finished

    def of_six(self) -> RationalFit | None:
        """Return the fit of (6), if there are points enough."""
        if not self._is_possible(LIU_SHAPE):
            return None
        return fit_rational(RationalProblem.of(
            LIU_SHAPE, self._points, self._delay_samples, positive=True))

    def grow(self, fits_delay: bool) -> RationalFit:
        """Fit higher and higher orders until the criterion rises; return the best one."""
        best = self.fit(shape_of(0, 1, fits_delay))
        worse, before = 0, best
        for order in range(2, _HIGHEST_ORDER + 1):
            # Of several modes, one alone may explain no more than none: the search goes on.
            if worse >= _PATIENCE and best.model_error < _SMALL_ERROR:
                break
            shape = shape_of(order - 1, order, fits_delay)
            if not self._is_possible(shape):
                break
            found = self.fit(shape, [with_a_pole_more(before.sections)])
            worse = 0 if _criterion(found) < _criterion(best) else worse + 1
            best = min(best, found, key=_criterion)
            before = found
        return best

    def thinned(self, fit: RationalFit) -> RationalFit:
        """Return the fit at which no smaller neighbour has a better criterion."""
        while True:
            found = min(
                (self.fit(shape, starts) for shape, starts in self._smaller(fit)),
                key=_criterion, default=fit)
            if _criterion(found) >= _criterion(fit):
                return fit
            fit = found

    def without_phantoms(self, fit: RationalFit) -> RationalFit:
        """Return a fit without narrow resonances that two points alone ask for."""
        while (masks := list(_narrow_pairs(fit))) and fit.problem.shape.numerator_order >= 2:
            shape = fit.problem.shape
            smaller = shape._replace(
                numerator_order=shape.numerator_order - 2, second_order=shape.second_order - 1)
            if smaller.denominator_order < 1 or not any(
                    self._is_phantom(shape, smaller, mask) for mask in masks):
                return fit
            fit = self.thinned(self.fit(smaller))
        return fit

    def plausible(self, fit: RationalFit) -> RationalFit:
        """
        Return a fit that does not take errors of the stage for its dynamics.

        Where no model explains the points within their noise, they contain what hysteresis leaves,
        and each order more fits a little of that. A dc gain below zero is such a fit too, as long
        as another model has none.
        """
        rivals = [other for other in self.fits.values() if other.sections.numerator[0] > 0.0]
        if not rivals:
            return fit
        least = min(other.reduced_chi_squared for other in rivals)
        if least > _UNEXPLAINED:
            return min(rivals, key=lambda other: other.bayesian_criterion(STAGE_ERROR))
        return fit if fit.sections.numerator[0] > 0.0 else min(rivals, key=_criterion)

    def smallest_of_equals(self, fit: RationalFit) -> RationalFit:
        """Return a smaller fit of nearly the same criterion if it predicts unseen points better."""
        limit = _criterion(fit) + _NEARLY
        size = fit.problem.shape.size
        rivals = [
            other for other in self.fits.values()
            if other.problem.shape.size < size and _criterion(other) < limit]
        if not rivals:
            return fit
        scores = []
        for other in (*sorted(rivals, key=_criterion)[:2], fit):
            unseen = held_out(other.problem.shape, self._points, self._delay_samples)
            scores.append((unseen.deviance if unseen else _criterion(other), other))
        limit = min(deviance for deviance, _ in scores) + _EQUAL
        return min(
            (other for deviance, other in scores if deviance <= limit),
            key=lambda other: other.problem.shape.size)

    def _is_possible(self, shape: Shape) -> bool:
        return shape.size <= self._points.frequency_hz.size

    def _smaller(self, fit: RationalFit) -> Iterator[tuple[Shape, list[Sections]]]:
        """Yield shapes with fewer zeros, poles or no delay, with starts where one is at hand."""
        zeros, poles = fit.problem.shape.numerator_order, fit.problem.shape.denominator_order
        delayed = fit.problem.shape.fits_delay
        steps = [(1, 0), (1, 1), (2, 2), (0, 1), (2, 1)]
        for fewer_zeros, fewer_poles in steps:
            n, m = zeros - fewer_zeros, poles - fewer_poles
            if 0 <= n < m:
                starts = []
                if fewer_poles == 0:
                    starts.append(fit.sections._replace(
                        numerator=fit.sections.numerator[:n + 1]))
                yield shape_of(n, m, delayed), starts
        yield shape_of(zeros, poles, not delayed), [fit.sections]

    def _is_phantom(self, shape: Shape, smaller: Shape, mask: NDArray[np.bool_]) -> bool:
        others = self._points.select(mask)
        with_pair, without = (
            fit_rational(
                RationalProblem.of(each, others, self._delay_samples), effort=COARSE)
            for each in (shape, smaller))
        return _criterion(without) <= _criterion(with_pair)


def _narrow_pairs(fit: RationalFit) -> Iterator[NDArray[np.bool_]]:
    """Yield, for each pair narrower than the spacing of the points, the points not beside it."""
    measured = fit.problem.frequency
    for frequency, damping in zip(
            np.exp(fit.sections.log_frequency).tolist(), np.exp(fit.sections.log_damping).tolist(),
            strict=True):
        after = int(np.searchsorted(measured, frequency))
        beside = [place for place in (after - 1, after) if 0 <= place < measured.size]
        spacing = float(np.ptp(measured[beside])) if len(beside) == 2 else 0.0
        if len(beside) == 2 and damping < 1.0 and 2.0 * damping * frequency < spacing:
            mask = np.ones(measured.size, dtype=np.bool_)
            mask[beside] = False
            yield mask


def _criterion(fit: RationalFit) -> float:
    return fit.bayesian_criterion(_LEAST_ERROR)
