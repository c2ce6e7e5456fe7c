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

"""Draws hysteresis as the deviation from a straight line, where a loop hides the errors."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from piezo_ros.report.figures.panels import WIDTH_IN, percent_axis
from piezo_ros.report.figures.style import FAINT, LINE_STYLES, SERIES, figure_style

__all__ = ['ModelResidual', 'loop_deviation_figure', 'model_comparison_figure']

_MOST_PLOTTED: Final = 4000

_Floats = NDArray[np.float64]


class ModelResidual(NamedTuple):
    """
    How well one model explains the loops.

    Attributes
    ----------
    name : str
        The model.
    parameters_count : int
        Its number of parameters.
    rms_nm, held_out_rms_nm : float
        Residual of the fit, and of loops that the fit has not seen, nanometres.

    """

    name: str
    parameters_count: int
    rms_nm: float
    held_out_rms_nm: float


def loop_deviation_figure(
    voltage_v: _Floats, displacement_um: _Floats, residual_um: _Floats, label: str,
) -> Figure:
    """
    Draw measured loops and a model without their common straight line.

    Parameters
    ----------
    voltage_v, displacement_um : ndarray, shape (N,)
        The measured loops.
    residual_um : ndarray, shape (N,)
        Measured less model.
    label : str
        Name of the model.

    Returns
    -------
    Figure
        Deviation of both from the straight line of least squares, and below it the residual on a
        scale of its own.

    """
    slope, offset = np.polyfit(voltage_v, displacement_um, 1)
    step = -(-voltage_v.size // _MOST_PLOTTED)
    shown = slice(None, None, step)
    line_um = slope * voltage_v + offset
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 5.4))
        above = figure.add_axes((0.1, 0.45, 0.885, 0.47))
        below = figure.add_axes((0.1, 0.1, 0.885, 0.29), sharex=above)
        above.plot(
            voltage_v[shown], 1e3 * (displacement_um - line_um)[shown], color=FAINT, linewidth=2.6,
            label='measured')
        above.plot(
            voltage_v[shown], 1e3 * (displacement_um - residual_um - line_um)[shown],
            color=SERIES[3], linewidth=1.1, linestyle='dashed', label=label)
        above.set_ylabel('deviation (nm)')
        above.tick_params(labelbottom=False)
        above.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=2, borderpad=0,
                     borderaxespad=0.4)
        below.plot(voltage_v[shown], 1e3 * residual_um[shown], color=SERIES[0], linewidth=0.7)
        below.set_xlabel('voltage (V)')
        below.set_ylabel('residual (nm)')
        figure.align_ylabels()
    return figure


def model_comparison_figure(models: Sequence[ModelResidual]) -> Figure:
    """
    Draw the residuals of several hysteresis models beside each other.

    Parameters
    ----------
    models : sequence of ModelResidual
        At least one.

    Returns
    -------
    Figure
        One row a model, on a logarithmic scale.

    """
    height_in = 0.95 + 0.42 * len(models)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        names = [f'{model.name} ({model.parameters_count})' for model in models]
        left = 0.03 + 0.0102 * max(map(len, names))
        axes = figure.add_axes((left, 0.5 / height_in, 0.97 - left, 1.0 - 0.85 / height_in))
        for place, model in enumerate(models):
            axes.plot(
                [model.rms_nm, model.held_out_rms_nm], [place, place], color=FAINT,
                linestyle=LINE_STYLES[0], linewidth=1.2, zorder=1)
        places = range(len(models))
        axes.plot([model.rms_nm for model in models], places, linestyle='none', marker='o',
                  markersize=7, color=SERIES[0], label='fit')
        axes.plot([model.held_out_rms_nm for model in models], places, linestyle='none',
                  marker='D', markersize=7, markerfacecolor='none', markeredgewidth=1.6,
                  color=SERIES[3], label='samples held out')
        percent_axis(axes, 'x')
        axes.set_yticks(list(places), names)
        axes.invert_yaxis()
        axes.margins(y=0.2)
        axes.grid(axis='y', visible=False)
        axes.set_xlabel('residual, rms (nm); in brackets the number of parameters')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=2, borderpad=0,
                    borderaxespad=0.4)
    return figure
