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
How far a fitted model may be trusted: by points that its fit has not seen, and by its residual.

A model agrees with the points where magnitude and phase differ by no more than 3 % and 2 degrees,
beyond three standard errors of the noise, point by point and in means over 3 and 7 neighbours, and
where its own 95 % region is as small and other structures of nearly the same evidence agree. It is
usable up to the frequency below the first one where it does not agree. With r_k the residuals in
the order of frequency, over their standard errors,

    correlation = Re sum_k r_k conj(r_{k+1}) / sum_k |r_k|^2,   standard error 1/sqrt(2 N)

is 0 for the noise of the points, and positive where the structure is wrong.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.dynamics.rational_fit import (
    RationalFit,
    RationalProblem,
    fit_rational,
)
from piezo_ros.identification.dynamics.rational_model import sampled_response
from piezo_ros.identification.dynamics.structure_choice import (
    STAGE_ERROR,
    held_out,
    smallest_as_good,
    too_fast,
    undetermined,
)
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.identification.verdict import Verdict

__all__ = ['AGREED_MAGNITUDE', 'AGREED_PHASE', 'Validation', 'validate']

AGREED_MAGNITUDE: Final = 0.03
AGREED_PHASE: Final = math.radians(2.0)
_NOISE_ERRORS: Final = 3.0
_MARGIN: Final = 3.0  # model errors: what a structure misses in the points, these miss of the stage
_AT_ALL: Final = 1.5  # radius of a region at all frequencies together over that at one
_BETWEEN: Final = 12  # frequencies from a point to the next one
_NEIGHBOURS: Final = (1, 3, 7)
_WHITE: Final = 3.0  # standard errors of the correlation
_POOR_ERROR: Final = 0.03  # model error, over the geometric mean of the response and its maximum
_POOR_FIT_PERCENT: Final = 50.0
_LEAST_SHARE: Final = 0.1  # of the highest frequency, up to which a model must be usable
_LEAST_POINTS: Final = 3  # that must be explained
_STRONG: Final = 10.0  # difference of the Bayesian criterion
_LEAD_SAMPLES: Final = 5.0  # of a delay below 0 that is looked for


@dataclass(frozen=True)
class Validation:
    """
    What a fit is worth.

    Attributes
    ----------
    held_out_fit_percent : float
        100 (1 - ||y - yhat||/||y - mean||) of points that were left out of the fit in turn; NaN
        where there are too few.
    residual_correlation : float
        Of neighbouring residuals; 0 for noise.
    residual_is_white : bool
        Whether this correlation is that of noise.
    usable_to_hz : float
        Up to where model and points agree; 0 for nowhere.
    largest_misfit_percent, largest_misfit_hz : float
        Largest distance of a point from the model over the size of the response, beyond the noise.
    verdict : Verdict
        The judgement.

    """

    held_out_fit_percent: float
    residual_correlation: float
    residual_is_white: bool
    usable_to_hz: float
    largest_misfit_percent: float
    largest_misfit_hz: float
    verdict: Verdict


def validate(
    fit: RationalFit, points: FrequencyResponse, delay_samples: float, *,
    radius: Callable[[NDArray[np.float64]], NDArray[np.float64]], structure: str,
    rivals: Sequence[RationalFit] | None = None,
) -> Validation:
    """
    Judge a fit.

    Parameters
    ----------
    fit : RationalFit
        The fit.
    points : FrequencyResponse
        The points that it was fitted to.
    delay_samples : float
        The known delay, in samples.
    radius : callable
        Returns the radius of the 95 % region of the model at frequencies in hertz.
    structure : str
        ``'liu'`` for (6), else ``'rational'``.
    rivals : sequence of RationalFit, optional
        Other structures with which this one was compared, of nearly the same evidence; None where
        the structure was given.

    """
    problem = fit.problem
    value, _ = sampled_response(fit.sections, problem.frequency, problem.sample_period)
    error = (points.response - value) / np.sqrt(
        points.variance + fit.model_error**2 * problem.power)
    correlation = float(
        np.sum(error[:-1] * error[1:].conj()).real / max(np.sum(np.abs(error)**2), 1e-300))
    white = abs(correlation) * math.sqrt(2.0 * error.size) < _WHITE
    agree, usable = (
        _usable_to_hz(
            points, value, is_uncertain, min(_MARGIN * fit.model_error, 0.5 * AGREED_MAGNITUDE))
        for is_uncertain in (
            np.zeros(points.frequency_hz.size, dtype=np.bool_),
            _is_uncertain(fit, points.frequency_hz, radius, rivals or ())))
    beyond = np.maximum(
        np.abs(points.response - value) - _NOISE_ERRORS * points.standard_error, 0.0)
    misfit = beyond / np.abs(value)
    worst = int(np.argmax(misfit))
    unseen = held_out(
        problem.shape, points, delay_samples, positive=structure == 'liu')
    percent = unseen.fit_percent(points.response) if unseen else math.nan
    top = float(points.frequency_hz[-1])
    poor = [
        *_misfit_reasons(fit, percent, agree, usable, points),
        *(() if rivals is not None else _surplus_reasons(fit, points, delay_samples, structure)),
        *_lead_reasons(fit, points, delay_samples)]
    remarks = _remarks(fit, white)
    if poor:
        verdict = Verdict.poor(*poor, *remarks)
    elif usable < top:
        verdict = Verdict.usable_up_to(f'{usable:.4g} Hz', _beyond(points, usable), *remarks)
    else:
        verdict = Verdict.good(*remarks)
    return Validation(
        percent, correlation, white, usable, 100.0 * float(misfit[worst]),
        float(points.frequency_hz[worst]), verdict)


def _is_uncertain(
    fit: RationalFit, frequency_hz: NDArray[np.float64],
    radius: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    rivals: Sequence[RationalFit],
) -> NDArray[np.bool_]:
    """Return where the model is not determined well enough, from the point before to each one."""
    # Between points too: a narrow resonance may lie there.
    share = np.arange(1, _BETWEEN + 1) / _BETWEEN
    before = np.concatenate([frequency_hz[:1], frequency_hz[:-1]])
    grid = before[:, None] + (frequency_hz - before)[:, None] * share
    problem = fit.problem
    scaled = 2.0 * np.pi * grid.ravel() / problem.reference
    value, _ = sampled_response(fit.sections, scaled, problem.sample_period)
    uncertain = _AT_ALL * radius(grid.ravel()) > AGREED_MAGNITUDE * np.abs(value)
    for rival in rivals:
        other, _ = sampled_response(rival.sections, scaled, problem.sample_period)
        ratio = other / value - 1.0
        uncertain |= (np.abs(ratio.real) > AGREED_MAGNITUDE) | (np.abs(ratio.imag) > AGREED_PHASE)
    return np.asarray(uncertain.reshape(grid.shape).any(axis=1))


def _usable_to_hz(
    points: FrequencyResponse, value: NDArray[np.complex128], is_uncertain: NDArray[np.bool_],
    margin: float,
) -> float:
    """Return the frequency below the first one where model and points do not agree."""
    size = np.abs(value)
    relative = points.response / value - 1.0
    information = (size / np.maximum(points.standard_error, 1e-12 * size))**2
    fails = is_uncertain.copy()
    for count in _NEIGHBOURS:
        if count > size.size:
            break
        total = np.convolve(information, np.ones(count), 'valid')
        mean = np.convolve(information * relative, np.ones(count), 'valid') / total
        allowance = _NOISE_ERRORS / np.sqrt(total)
        apart = (np.abs(mean.real) > AGREED_MAGNITUDE - margin + allowance) | (
            np.abs(mean.imag) > AGREED_PHASE - margin + allowance)
        fails[:apart.size] |= apart
    first = int(np.argmax(fails)) if fails.any() else fails.size
    return float(points.frequency_hz[first - 1]) if first > 0 else 0.0


def _beyond(points: FrequencyResponse, usable_to_hz: float) -> str:
    after = points.frequency_hz[points.frequency_hz > usable_to_hz]
    return (
        f'at {float(after[0]):.4g} Hz model and points differ by over '
        f'{100 * AGREED_MAGNITUDE:.0f} % or {math.degrees(AGREED_PHASE):.0f} degrees, or the model '
        'is that uncertain')


def _misfit_reasons(
    fit: RationalFit, percent: float, agree_to_hz: float, usable_to_hz: float,
    points: FrequencyResponse,
) -> list[str]:
    reasons = []
    top_hz = float(points.frequency_hz[-1])
    if fit.model_error > _POOR_ERROR:
        reasons.append(
            f'the model misses the points by {100 * fit.model_error:.2g} % of the response, '
            f'reduced chi squared {fit.reduced_chi_squared:.3g}')
    if percent < _POOR_FIT_PERCENT:
        reasons.append(
            f'it explains {percent:.3g} % of points that it has not seen, '
            f'{_POOR_FIT_PERCENT:.0f} % are needed')
    agreed, known = (
        int(np.sum(points.frequency_hz <= limit_hz)) for limit_hz in (agree_to_hz, usable_to_hz))
    if agree_to_hz < _LEAST_SHARE * top_hz or agreed < _LEAST_POINTS:
        reasons.append(
            f'model and points agree up to {agree_to_hz:.4g} Hz only, of {top_hz:.4g} Hz measured')
    elif known < _LEAST_POINTS:
        reasons.append(
            f'the points determine the model up to {usable_to_hz:.4g} Hz only, of {top_hz:.4g} Hz '
            'measured')
    return reasons


def _surplus_reasons(
    fit: RationalFit, points: FrequencyResponse, delay_samples: float, structure: str,
) -> list[str]:
    """Return that a smaller model explains the points as well, with what is not determined."""
    names = undetermined(fit)
    smaller = smallest_as_good(fit, points, delay_samples)
    gain = fit.bayesian_criterion() - smaller.bayesian_criterion()
    if smaller is fit or gain < (0.0 if names else _STRONG):
        return []
    shape = smaller.problem.shape
    model = 'parameters of (6)' if structure == 'liu' else 'parameters'
    which = f': {", ".join(names)}' if names else ''
    delay = ' with a delay' if shape.fits_delay else ''
    return [(
        f'{model} are not determined by the points{which}; orders {shape.numerator_order} '
        f'{shape.denominator_order}{delay} explain them as well')]


def _lead_reasons(
    fit: RationalFit, points: FrequencyResponse, delay_samples: float,
) -> list[str]:
    """Return that the phase asks for a delay below 0, which no stage has."""
    if fit.explains or fit.sections.delay > 0.0:
        return []
    shape = fit.problem.shape._replace(fits_delay=True)
    if shape.size > points.frequency_hz.size:
        return []
    free = fit_rational(
        RationalProblem.of(
            shape, points, delay_samples, least_delay_samples=-_LEAD_SAMPLES), [fit.sections])
    error = float(free.covariance.standard_errors(np.eye(shape.size)[-1:])[0])
    gained = fit.bayesian_criterion() - free.bayesian_criterion()
    # What hysteresis leaves in the points may look like a little lead.
    if (fit.model_error < STAGE_ERROR or gained < _STRONG
            or free.sections.delay + 3.0 * error >= 0.0):
        return []
    lead_s = -free.sections.delay / fit.problem.reference
    return [(
        f'the phase asks for a delay of -{lead_s:.3g} s, which no stage has: the displacement '
        'seems to be recorded before its command')]


def _remarks(fit: RationalFit, white: bool) -> list[str]:
    remarks = []
    if not fit.explains and fit.model_error <= _POOR_ERROR:
        remarks.append(
            f'the structure misses the points by {100 * fit.model_error:.2g} % beyond their noise, '
            'standard errors are those of the nearest model of this structure')
    elif fit.explains and not white:
        remarks.append('the residuals of neighbouring frequencies are correlated')
    names = undetermined(fit)
    if names:
        remarks.append(f'not determined: {", ".join(names)}')
    fast = too_fast(fit)
    if fast:
        remarks.append(f'too fast for the points to determine: {", ".join(fast)}')
    return remarks
