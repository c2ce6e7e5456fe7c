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

"""The figures of the whole paper beside the published numbers, each drawn from plain arrays."""

import math
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper
from piezo_ros.report.layout import WIDTH_IN
from piezo_ros.report.rendering import INK, SERIES, house_style
from piezo_ros.report.response_figures import (
    BoundCurve,
    ResponseCurve,
    response_figure,
    uncertainty_figure,
)
from piezo_ros.report.tracking_figures import (
    CrossingRow,
    HarmonicsCurve,
    TableCell,
    crossing_figure,
    harmonics_figure,
    table_4_figure,
)

__all__ = [
    'BoundCurve',
    'CrossingRow',
    'HarmonicsCurve',
    'Loop',
    'ResponseCurve',
    'TableCell',
    'crossing_figure',
    'harmonics_figure',
    'loops_figure',
    'response_figure',
    'straight_line_deviation',
    'table_4_figure',
    'uncertainty_figure',
]

_SHOWN_SAMPLES: Final = 2000


class Loop(NamedTuple):
    """
    One hysteresis loop of `loops_figure`.

    Attributes
    ----------
    input, displacement_um : array_like, shape (N,)
        Whole periods of the input and the measured displacement, micrometres.
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
    """Return how far a displacement lies from its straight line of least squares, shape (N,)."""
    abscissa = np.asarray(input_, dtype=np.float64)
    ordinate = np.asarray(displacement_um, dtype=np.float64)
    slope, offset = np.polyfit(abscissa, ordinate, 1)
    return np.asarray(ordinate - slope * abscissa - offset)


def loops_figure(uncompensated: Loop, compensated: Loop) -> Figure:
    """
    Draw the loops without and with the inverse hysteresis (Fig. 5 in Liu 2015).

    Parameters
    ----------
    uncompensated, compensated : Loop
        The two loops.

    Returns
    -------
    Figure
        The loops with their nonlinearity beside the published one; below each its deviation from
        a straight line, on a common scale.

    """
    published = (paper.UNCOMPENSATED_NONLINEARITY_PERCENT, paper.COMPENSATED_NONLINEARITY_PERCENT)
    titles = ('without compensation', 'with the inverse in series')
    with house_style():
        figure = Figure(figsize=(WIDTH_IN, 5.0))
        axes = figure.subplots(
            2, 2, sharey='row', sharex='col',
            gridspec_kw={'height_ratios': (3, 1), 'hspace': 0.12, 'wspace': 0.08, 'left': 0.1,
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
            bottom.plot(abscissa, deviation, color=colour, linewidth=1.0)
            bottom.set_xlabel(loop.input_label)
        axes[0, 0].set_ylabel('displacement (µm)')
        axes[1, 0].set_ylabel('deviation (µm)')
        figure.align_ylabels()
    return figure


def _thinned(*arrays: ArrayLike) -> list[NDArray[np.float64]]:
    """Return every so manieth sample of long records, as many as a picture can show."""
    whole = [np.asarray(array, dtype=np.float64) for array in arrays]
    stride = math.ceil(whole[0].size / _SHOWN_SAMPLES)
    return [array[::stride] for array in whole]
