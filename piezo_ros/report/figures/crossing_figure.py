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

"""Draws the frequency at which feedback stops helping: FF against FBFF, for each amplitude."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from piezo_ros.report.figures.panels import add_head, panel_grid, percent_axis
from piezo_ros.report.figures.style import (
    INK,
    SCHEME_MARKERS,
    figure_style,
    scheme_colour,
    scheme_line_style,
)
from piezo_ros.report.labels import scheme_label

__all__ = ['CrossingRow', 'crossing_figure']

_BAND_ALPHA: Final = 0.13


class CrossingRow(NamedTuple):
    """
    Errors under FF and FBFF at one amplitude, over frequency.

    Attributes
    ----------
    amplitude_um : float
        Peak amplitude, micrometres.
    frequency_hz, ff_percent, fbff_percent : array_like, shape (N,)
        Frequencies, hertz, and the NRMSE under each scheme, percent.
    published_band_hz : tuple of float or None
        Lowest and highest frequency at which both are equal in the paper (Table 3 in Liu 2015),
        hertz.
    crossing_hz : float or None
        Frequency at which they are equal here, hertz; None where they are not.

    """

    amplitude_um: float
    frequency_hz: ArrayLike
    ff_percent: ArrayLike
    fbff_percent: ArrayLike
    published_band_hz: tuple[float, float] | None
    crossing_hz: float | None


def crossing_figure(rows: Sequence[CrossingRow]) -> Figure:
    """
    Draw FF against FBFF over frequency (Fig. 10 and Table 3 in Liu 2015).

    Parameters
    ----------
    rows : sequence of CrossingRow
        One for each amplitude, at least one.

    Returns
    -------
    Figure
        One panel for each amplitude with the published band shaded, and a last panel with all
        bands and crossings.

    Raises
    ------
    ValueError
        If there is no row.

    """
    if not rows:
        raise ValueError('rows is empty, a figure needs at least one row')
    with figure_style():
        figure, panels, summary = panel_grid(
            len(rows), x_label='frequency (Hz)', y_label='NRMSE (%)', spare=True)
        assert summary is not None
        for panel, row in zip(panels, rows, strict=True):
            frequency_hz = np.asarray(row.frequency_hz, dtype=np.float64)
            errors = {'ff': row.ff_percent, 'fbff': row.fbff_percent}
            _published_band(panel, row.published_band_hz)
            for scheme, percent in errors.items():
                panel.plot(frequency_hz, np.asarray(percent), **_mark(scheme))
            if row.crossing_hz is not None:
                level = math.exp(np.interp(
                    row.crossing_hz, frequency_hz, np.log(np.asarray(row.ff_percent))))
                panel.plot([row.crossing_hz], [level], color=INK, marker='D', markersize=6.0)
            panel.set_title(f'{row.amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
            panel.set_title(
                'no crossing' if row.crossing_hz is None else f'{row.crossing_hz:.0f} Hz',
                loc='right', fontsize=9.5, fontweight='bold', pad=3)
        percent_axis(panels[0])
        _all_crossings(summary, rows)
        summary.sharex(panels[0])
        handles: list[Artist] = [
            Line2D([], [], label=scheme_label(scheme), **_mark(scheme))
            for scheme in ('ff', 'fbff')]
        add_head(figure, [
            *handles, Line2D([], [], color=INK, marker='D', markersize=6.0, linestyle='none',
                             label='equal, here'),
            Patch(color=INK, alpha=_BAND_ALPHA * 1.6, linewidth=0, label='equal, in the paper')])
    return figure


def _mark(scheme: str) -> dict[str, Any]:
    return {
        'color': scheme_colour(scheme), 'linestyle': scheme_line_style(scheme),
        'marker': SCHEME_MARKERS[scheme], 'markersize': 2.6}


def _published_band(panel: Axes, band_hz: tuple[float, float] | None) -> None:
    if band_hz is None:
        return
    if band_hz[0] == band_hz[1]:  # a single frequency has no width to shade
        panel.axvline(band_hz[0], color=INK, alpha=2.2 * _BAND_ALPHA, linewidth=3.0)
    else:
        panel.axvspan(*band_hz, color=INK, alpha=_BAND_ALPHA, linewidth=0)


def _all_crossings(panel: Axes, rows: Sequence[CrossingRow]) -> None:
    for height, row in enumerate(rows):
        if row.published_band_hz is not None:
            low, high = row.published_band_hz
            middle, width = (low + high) / 2, max(high - low, 12.0)
            panel.barh(height, width, left=middle - width / 2, height=0.5, color=INK,
                       alpha=2.2 * _BAND_ALPHA, linewidth=0)
        if row.crossing_hz is not None:
            panel.plot([row.crossing_hz], [height], color=INK, marker='D', markersize=5.0)
    panel.set_yticks(range(len(rows)), [f'{row.amplitude_um:g}' for row in rows])
    panel.set_ylim(-0.6, len(rows) - 0.4)
    panel.set_ylabel('amplitude (µm)')
    panel.set_xlabel('frequency (Hz)')
    panel.set_title('all amplitudes', loc='left', fontsize=9.5, pad=3)
