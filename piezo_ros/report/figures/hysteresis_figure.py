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

"""Draws hysteresis loops: displacement over voltage or command (Fig. 5 in Liu 2015)."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import INK, SERIES, figure_style, scheme_colour
from piezo_ros.report.labels import run_label
from piezo_ros.report.score import ScoredRun

__all__ = ['Loop', 'hysteresis_figure', 'loops_figure', 'straight_line_deviation']

_SHOWN_SAMPLES: Final = 2000
_NM_PER_UM: Final = 1e3


class Loop(NamedTuple):
    """
    One hysteresis loop of `loops_figure`.

    Attributes
    ----------
    input, displacement_um : array_like, shape (N,)
        Whole periods of the input, in volts or micrometres, and of the measured displacement,
        micrometres.
    input_label : str
        Name and unit of the input.
    nonlinearity_input_percent, nonlinearity_output_percent : float
        Width of the loop, percent of the peak-to-peak value.

    """

    input: ArrayLike
    displacement_um: ArrayLike
    input_label: str
    nonlinearity_input_percent: float
    nonlinearity_output_percent: float


def straight_line_deviation(input_: ArrayLike, displacement_um: ArrayLike) -> NDArray[np.float64]:
    """Return the deviation of a displacement from its least-squares line, um, shape (N,)."""
    abscissa = np.asarray(input_, dtype=np.float64)
    ordinate = np.asarray(displacement_um, dtype=np.float64)
    slope, offset = np.polyfit(abscissa, ordinate, 1)
    return np.asarray(ordinate - slope * abscissa - offset)


def loops_figure(uncompensated: Loop, compensated: Loop) -> Figure:
    """
    Draw the loops without and with the inverse hysteresis model (Fig. 5 in Liu 2015).

    Parameters
    ----------
    uncompensated, compensated : Loop
        The two loops.

    Returns
    -------
    Figure
        The loops with their nonlinearity beside the published one; below each its deviation from
        a straight line in nanometres, each on its own scale.

    """
    published = (paper.UNCOMPENSATED_NONLINEARITY_PERCENT, paper.COMPENSATED_NONLINEARITY_PERCENT)
    titles = ('without compensation', 'with the inverse in series')
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 5.0))
        axes = figure.subplots(
            2, 2, sharex='col',
            gridspec_kw={'height_ratios': (3, 1.3), 'hspace': 0.2, 'wspace': 0.16, 'left': 0.1,
                         'right': 0.985, 'top': 0.945, 'bottom': 0.1})
        for column, (loop, numbers, title, colour) in enumerate(zip(
                (uncompensated, compensated), published, titles, (SERIES[3], SERIES[0]),
                strict=True)):
            top, bottom = axes[:, column]
            abscissa, ordinate, deviation = _thinned(
                loop.input, loop.displacement_um,
                straight_line_deviation(loop.input, loop.displacement_um))
            top.plot(abscissa, ordinate, color=colour)
            top.set_title(title, loc='left', fontsize=10.5, fontweight='bold', pad=5)
            text = (
                (0.2, f'input nonlinearity {loop.nonlinearity_input_percent:.2f} %', 'bold'),
                (0.125, f'output nonlinearity {loop.nonlinearity_output_percent:.2f} %', 'bold'),
                (0.035, f'paper: {numbers["input"]:.2f} % and {numbers["output"]:.2f} %',
                 'normal'))
            for height, words, weight in text:
                top.text(0.98, height, words, transform=top.transAxes, ha='right', va='bottom',
                         color=colour if weight == 'bold' else INK, fontweight=weight)
            bottom.plot(abscissa, _NM_PER_UM * deviation, color=colour, linewidth=1.0)
            bottom.set_title(
                f'largest {_NM_PER_UM * np.abs(deviation).max():.3g} nm', loc='right',
                fontsize=9.0, pad=2)
            bottom.set_xlabel(loop.input_label)
        axes[0, 0].set_ylabel('displacement (µm)')
        axes[1, 0].set_ylabel('deviation (nm)')
        # Each its own scale: what the inverse leaves is a fiftieth of what it takes away.
        axes[1, 1].tick_params(labelleft=True)
        figure.align_ylabels()
    return figure


def _thinned(*arrays: ArrayLike) -> list[NDArray[np.float64]]:
    """Return at most `_SHOWN_SAMPLES` evenly spaced samples of each record."""
    whole = [np.asarray(array, dtype=np.float64) for array in arrays]
    stride = math.ceil(whole[0].size / _SHOWN_SAMPLES)
    return [array[::stride] for array in whole]


def hysteresis_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw displacement over voltage, one small panel for each run (compare Fig. 5 in Liu 2015).

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs, over the scored window.

    Returns
    -------
    Figure
        Panels with common axes, at most four in a row.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    columns = min(len(runs), 4)
    rows = math.ceil(len(runs) / columns)
    panel_in = min(2.3, (WIDTH_IN - 0.75) / columns)
    width_in, height_in = 0.75 + panel_in * columns, 0.75 + panel_in * rows
    with figure_style():
        figure = Figure(figsize=(width_in, height_in))
        panels = figure.subplots(
            rows, columns, sharex=True, sharey=True, squeeze=False,
            gridspec_kw={'left': 0.62 / width_in, 'right': 1 - 0.1 / width_in, 'wspace': 0.12,
                         'hspace': 0.22, 'top': 1 - 0.25 / height_in,
                         'bottom': 0.5 / height_in}).ravel()
        for panel, run in zip(panels, runs, strict=False):
            colour = scheme_colour(run.scheme)
            panel.plot(run.voltage_v, run.displacement_um, color=colour, linewidth=1.0)
            panel.set_title(run_label(run, runs), loc='left', color=colour, fontsize=9.5,
                            fontweight='bold', pad=4)
        for panel in panels[len(runs):]:
            panel.set_visible(False)
        for panel in panels[max(0, len(runs) - columns):len(runs)]:
            panel.set_xlabel('voltage (V)')
            panel.xaxis.set_tick_params(labelbottom=True)
        for panel in panels[::columns]:
            panel.set_ylabel('displacement (µm)')
    return figure
