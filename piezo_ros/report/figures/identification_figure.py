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

"""Draws the results of an identification: measurements beside the fitted model."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from piezo_ros.identification import (
    DynamicsFit,
    FrequencyResponse,
    HysteresisFit,
    UncertaintyBound,
)
from piezo_ros.identification.creep.creep_fit import CreepFit
from piezo_ros.report.figures.frequency_response_figure import ResponseCurve, response_figure
from piezo_ros.report.figures.style import FAINT, SERIES, figure_style
from piezo_ros.report.figures.uncertainty_figure import BoundCurve, uncertainty_figure

__all__ = ['bound_figure', 'creep_figure', 'fitted_response_figure', 'residual_figure']

_MOST_PLOTTED: Final = 4000  # points of a curve; more cannot be distinguished
_MOST_AMPLITUDES: Final = 6
_MODEL_POINTS: Final = 300


def residual_figure(fit: HysteresisFit) -> Figure:
    """
    Draw the measured loops with the fitted model, and below them the residual.

    Parameters
    ----------
    fit : HysteresisFit
        The identified hysteresis.

    Returns
    -------
    Figure
        Displacement and residual over voltage.

    """
    step = -(-fit.voltage_v.size // _MOST_PLOTTED)
    voltage_v, displacement_um, residual_um = (
        values[::step] for values in (fit.voltage_v, fit.displacement_um, fit.residual_um))
    with figure_style():
        figure = Figure(figsize=(6.4, 5.6), layout='constrained')
        loops, residual = figure.subplots(2, 1, sharex=True, gridspec_kw={'height_ratios': (3, 2)})
        loops.plot(voltage_v, displacement_um, color=FAINT, linewidth=2.4, label='measured')
        loops.plot(
            voltage_v, displacement_um - residual_um, color=SERIES[0], linewidth=0.7,
            label=f'MRC, {fit.elements} elements' + (
                ' and asymmetry' if fit.parameters.asymmetry_weight else ''))
        loops.set_ylabel('displacement (µm)')
        loops.legend()
        residual.plot(voltage_v, 1e3 * residual_um, color=SERIES[0], linewidth=0.5)
        residual.set_xlabel('voltage (V)')
        residual.set_ylabel('residual (nm)')
        residual.set_title(f'{1e3 * fit.rms_um:.3g} nm rms', loc='right', fontsize='medium')
    return figure


def fitted_response_figure(response: FrequencyResponse, fit: DynamicsFit) -> Figure:
    """
    Draw a measured frequency response and the model fitted to it, both with 95 % confidence.

    Parameters
    ----------
    response : FrequencyResponse
        The measured points, of one or several amplitudes.
    fit : DynamicsFit
        The model; drawn is its sampled response, as in the record.

    Returns
    -------
    Figure
        Magnitude and phase over frequency.

    """
    labels = np.array([f'{amplitude:.2g} µm' for amplitude in response.amplitude])
    distinct = [str(label) for label in dict.fromkeys(labels[np.argsort(response.amplitude)])]
    curves = []
    if len(distinct) > _MOST_AMPLITUDES:
        curves.append(_points('measured', response))
    else:
        curves += [_points(label, response.select(labels == label)) for label in distinct]
    frequency_hz = np.geomspace(*fit.frequency_range_hz, _MODEL_POINTS)
    curves.append(ResponseCurve(
        'model', frequency_hz, fit.sampled_response(frequency_hz),
        fit.response_confidence_radius(frequency_hz), style='line'))
    return response_figure(curves, title='Compensated actuator', unit='µm/µm')


def _points(label: str, response: FrequencyResponse) -> ResponseCurve:
    return ResponseCurve(
        label, response.frequency_hz, response.response, response.confidence_radius)


def bound_figure(bound: UncertaintyBound) -> Figure:
    """
    Draw the measured uncertainty under its bound.

    Parameters
    ----------
    bound : UncertaintyBound
        The bound and the points that it was fitted to.

    Returns
    -------
    Figure
        |Delta| and |W| over frequency.

    """
    lowest, highest = float(bound.frequency_hz.min()), float(bound.frequency_hz.max())
    frequency_hz = np.geomspace(lowest, max(highest, 1.01 * lowest), _MODEL_POINTS)
    return uncertainty_figure(
        bound.frequency_hz, np.abs(bound.uncertainty),
        [BoundCurve(f'W, order {bound.order}', frequency_hz, bound.magnitude(frequency_hz))])


def creep_figure(fit: CreepFit) -> Figure:
    """
    Draw what a stage has crept, measured and as identified, and below it the residual.

    Parameters
    ----------
    fit : CreepFit
        The identified creep.

    Returns
    -------
    Figure
        Creep and residual over time.

    """
    step = -(-fit.time_s.size // _MOST_PLOTTED)
    time_s, displacement_um, still_um, predicted_um = (
        values[::step] for values in (
            fit.time_s, fit.displacement_um, fit.still_um, fit.predicted_um))
    with figure_style():
        figure = Figure(figsize=(6.4, 5.6), layout='constrained')
        crept, residual = figure.subplots(2, 1, sharex=True, gridspec_kw={'height_ratios': (3, 2)})
        crept.plot(
            time_s, 1e3 * (displacement_um - still_um), color=FAINT, linewidth=2.4,
            label='measured')
        crept.plot(
            time_s, 1e3 * (predicted_um - still_um), color=SERIES[0], linewidth=0.9,
            label=f'creep, {100.0 * fit.parameters.creep_per_decade:.3g} % a decade, and drift')
        crept.set_ylabel('creep (nm)')
        crept.legend()
        residual.plot(
            time_s, 1e3 * (displacement_um - predicted_um), color=SERIES[0], linewidth=0.5)
        residual.set_xlabel('time (s)')
        residual.set_ylabel('residual (nm)')
        residual.set_title(f'{1e3 * fit.rms_um:.3g} nm rms', loc='right', fontsize='medium')
    return figure
