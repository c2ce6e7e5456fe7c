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

"""Draws the multiplicative uncertainty Delta of (7) in Liu 2015 and its bounds |W|."""

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.figures.panels import (
    LEGEND_ROW_IN,
    WIDTH_IN,
    legend_grid,
    logarithmic_frequency_axis,
)
from piezo_ros.report.figures.style import (
    FAINT,
    INK,
    LINE_STYLES,
    MANY_POINTS,
    SERIES,
    figure_style,
)

__all__ = ['BoundCurve', 'uncertainty_figure']

_BOUND_COLOURS: Final = (INK, *SERIES[2:], *SERIES[:2])
_SUPERSCRIPTS: Final = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


class BoundCurve(NamedTuple):
    """
    One bound of `uncertainty_figure`.

    Attributes
    ----------
    label : str
        Its name in the legend.
    frequency_hz, magnitude : array_like, shape (N,)
        Frequencies, hertz, and |W| at each of them.

    """

    label: str
    frequency_hz: ArrayLike
    magnitude: ArrayLike


def uncertainty_figure(
    frequency_hz: ArrayLike, uncertainty: ArrayLike, bounds: Sequence[BoundCurve],
) -> Figure:
    """
    Draw the measured uncertainty and its bounds (Fig. 8 in Liu 2015).

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Frequencies of all measured points, hertz.
    uncertainty : array_like of float or complex, shape (N,)
        Delta at these points.
    bounds : sequence of BoundCurve
        |W|, each a line.

    Returns
    -------
    Figure
        |Delta| as faint points under the bounds, both axes logarithmic.

    Raises
    ------
    ValueError
        If the lengths differ, or there is no point.

    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    size = np.abs(np.asarray(uncertainty))
    if frequency.shape != size.shape or size.ndim != 1 or size.size == 0:
        raise ValueError(
            f'frequency_hz has shape {frequency.shape} and uncertainty {size.shape}, they must be '
            'equally long and not empty')
    measured = 'measured |Δ|'
    legend = legend_grid([measured, *(bound.label for bound in bounds)])
    more_in = LEGEND_ROW_IN * (legend.rows - 1)
    height_in = 3.7 + more_in
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        axes = figure.subplots(gridspec_kw={
            'left': 0.1, 'right': 0.985, 'top': 1 - (0.35 + more_in) / height_in,
            'bottom': 0.5 / height_in})
        axes.plot(frequency, size, linestyle='none', marker='o', markersize=3.4, color=FAINT,
                  markeredgewidth=0, alpha=0.55, rasterized=size.size > MANY_POINTS,
                  label=measured)
        for bound, colour, line_style in zip(
                bounds, cycle(_BOUND_COLOURS), cycle(LINE_STYLES), strict=False):
            axes.plot(np.asarray(bound.frequency_hz), np.asarray(bound.magnitude), color=colour,
                      linestyle=line_style, linewidth=1.7, label=bound.label)
        axes.set_yscale('log', nonpositive='mask')
        axes.yaxis.set_major_formatter(lambda value, _: _power_of_ten(value))
        axes.set_ylim(_uncertainty_limits(size, bounds))
        axes.set_ylabel('magnitude')
        axes.set_xlabel('frequency (Hz)')
        logarithmic_frequency_axis(
            axes, [frequency, *(np.asarray(bound.frequency_hz) for bound in bounds)])
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=legend.columns, borderpad=0,
                    borderaxespad=0.35, handlelength=1.8, columnspacing=1.8)
    return figure


def _power_of_ten(value: float) -> str:
    if value >= 1e-3:
        return f'{value:g}'
    return f'10{str(round(math.log10(value))).translate(_SUPERSCRIPTS)}'


def _uncertainty_limits(
    size: NDArray[np.float64], bounds: Sequence[BoundCurve],
) -> tuple[float, float]:
    """Return limits that show all bounds and nearly all points: a few points are almost 0."""
    seen = [float(np.percentile(size[size > 0.0], 1.0))] if np.any(size > 0.0) else [1e-3]
    seen += [float(np.min(np.asarray(bound.magnitude))) for bound in bounds]
    high = max([float(size.max()), *(float(np.max(np.asarray(bound.magnitude)))
                                     for bound in bounds)])
    return 0.7 * float(min(seen)), 1.4 * max(high, 1e-3)
