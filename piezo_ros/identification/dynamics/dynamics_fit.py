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

import numpy as np

from piezo_ros.identification.dynamics.identified_dynamics import DynamicsFit, as_sections
from piezo_ros.identification.dynamics.named_parameters import named_liu, named_rational
from piezo_ros.identification.dynamics.rational_fit import (
    FASTEST,
    RationalFit,
    RationalProblem,
    bootstrapped,
    fit_rational,
)
from piezo_ros.identification.dynamics.rational_model import Shape
from piezo_ros.identification.dynamics.structure_choice import (
    LIU_SHAPE,
    Candidate,
    choose_structure,
    shape_of,
)
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.model.dynamics import DynamicsParameters
from piezo_ros.model.parameters import ParameterError

__all__ = ['STRUCTURES', 'DynamicsFit', 'fit_dynamics']

STRUCTURES = ('liu', 'rational', 'auto')
_HIGHEST_ORDER = 20


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


def _parameters(
    structure: str, fit: RationalFit, values: Mapping[str, float], delay_s: float,
) -> DynamicsParameters | None:
    common = {'delay_s': delay_s, 'hysteresis_place': 'undecided'}
    if structure == 'liu':
        return DynamicsParameters.from_mapping({**values, **common})
    try:
        return DynamicsParameters.from_mapping({**as_sections(fit), **common})
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
