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

"""Tracking errors over frequency, amplitude and harmonics, ours and the published ones."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from piezo_ros import paper
from piezo_ros.report.layout import head, panel_grid, percent_axis
from piezo_ros.report.rendering import INK, SERIES, house_style, scheme_colour

__all__ = [
    'CrossingRow',
    'HarmonicsCurve',
    'TableCell',
    'crossing_figure',
    'harmonics_figure',
    'table_4_figure',
]

_SCHEMES: Final = (('ff', 'FF'), ('fbff', 'FBFF'))
_BAND_ALPHA: Final = 0.13
# Any: matplotlib's types know no dictionary of settings.
_PAPER_MARK: Final[Any] = {
    'linestyle': 'none', 'marker': 'o', 'markersize': 7.0, 'markerfacecolor': 'none'}
_CHOSEN_MARK: Final[Any] = _PAPER_MARK | {
    'markersize': 9.0, 'markeredgecolor': INK, 'markeredgewidth': 1.4}


class CrossingRow(NamedTuple):
    """
    FF and FBFF at one amplitude, over frequency.

    Attributes
    ----------
    amplitude_um : float
        Peak amplitude, micrometres.
    frequency_hz, ff_percent, fbff_percent : array_like, shape (N,)
        Frequencies, hertz, and the NRMSE under either scheme, percent.
    published_band_hz : tuple of float or None
        Lowest and highest frequency at which the paper finds both equal (Table 3 in Liu 2015).
    crossing_hz : float or None
        Where they are equal here; None where they are not.

    """

    amplitude_um: float
    frequency_hz: ArrayLike
    ff_percent: ArrayLike
    fbff_percent: ArrayLike
    published_band_hz: tuple[float, float] | None
    crossing_hz: float | None


class TableCell(NamedTuple):
    """One condition of Table 4 in Liu 2015: errors in percent, ours and the published."""

    amplitude_um: float
    frequency_hz: float
    ff: float
    fbff: float
    paper_ff: float
    paper_fbff: float

    @property
    def same_winner(self) -> bool:
        """Whether the better scheme is the published one."""
        return (self.ff < self.fbff) == (self.paper_ff < self.paper_fbff)


class HarmonicsCurve(NamedTuple):
    """
    Error over the number of harmonics at one operating point.

    Attributes
    ----------
    label : str
        The operating point.
    harmonics, predicted_percent, measured_percent : array_like, shape (N,)
        m, and the NRMSE predicted and measured, percent; NaN where not measured.
    chosen : int
        The m that was chosen; one of `harmonics`.

    """

    label: str
    harmonics: ArrayLike
    predicted_percent: ArrayLike
    measured_percent: ArrayLike
    chosen: int


def crossing_figure(rows: Sequence[CrossingRow]) -> Figure:
    """
    Draw where feedback stops helping, for each amplitude (Fig. 10 and Table 3 in Liu 2015).

    Parameters
    ----------
    rows : sequence of CrossingRow
        One an amplitude, at least one.

    Returns
    -------
    Figure
        One panel an amplitude with the published band shaded, and a last one of all bands and
        crossings.

    Raises
    ------
    ValueError
        If there is no row.

    """
    if not rows:
        raise ValueError('rows is empty, a figure needs at least one row')
    with house_style():
        figure, panels, summary = panel_grid(
            len(rows), x_label='frequency (Hz)', y_label='NRMSE (%)', spare=True)
        assert summary is not None
        for panel, row in zip(panels, rows, strict=True):
            frequency_hz = np.asarray(row.frequency_hz, dtype=np.float64)
            errors = dict(zip(('ff', 'fbff'), (row.ff_percent, row.fbff_percent), strict=True))
            _published_band(panel, row.published_band_hz)
            for scheme, _ in _SCHEMES:
                panel.plot(frequency_hz, np.asarray(errors[scheme]), color=scheme_colour(scheme),
                           marker='o', markersize=2.6)
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
            Line2D([], [], color=scheme_colour(scheme), marker='o', markersize=2.6, label=label)
            for scheme, label in _SCHEMES]
        head(figure, [
            *handles, Line2D([], [], color=INK, marker='D', markersize=6.0, linestyle='none',
                             label='equal, here'),
            Patch(color=INK, alpha=_BAND_ALPHA * 1.6, linewidth=0, label='equal, in the paper')])
    return figure


def table_4_figure(
    cells: Sequence[TableCell], *, title: str, mark_winners: bool = True,
) -> Figure:
    """
    Draw every cell of Table 4 in Liu 2015, ours and the published.

    Parameters
    ----------
    cells : sequence of TableCell
        At least one.
    title : str
        Heading.
    mark_winners : bool, optional
        Whether to shade the conditions with another winner than the published one.

    Returns
    -------
    Figure
        One panel an amplitude, ours as lines and the published as open circles. A last panel sets
        ours against the published, cell by cell.

    Raises
    ------
    ValueError
        If there is no cell.

    """
    if not cells:
        raise ValueError('cells is empty, a figure needs at least one cell')
    amplitudes = sorted({cell.amplitude_um for cell in cells})
    with house_style():
        figure, panels, summary = panel_grid(
            len(amplitudes), x_label='frequency (Hz)', y_label='NRMSE (%)', spare=True,
            title=title)
        assert summary is not None
        half_width = 0.35 * _least_step(sorted({cell.frequency_hz for cell in cells}))
        for panel, amplitude_um in zip(panels, amplitudes, strict=True):
            mine = sorted(cell for cell in cells if cell.amplitude_um == amplitude_um)
            for cell in mine:
                if mark_winners and not cell.same_winner:
                    panel.axvspan(cell.frequency_hz - half_width, cell.frequency_hz + half_width,
                                  color=INK, alpha=_BAND_ALPHA, linewidth=0)
            frequency_hz = [cell.frequency_hz for cell in mine]
            for scheme, _ in _SCHEMES:
                colour = scheme_colour(scheme)
                panel.plot(frequency_hz, [getattr(cell, scheme) for cell in mine], color=colour,
                           marker='o', markersize=3.6)
                panel.plot(frequency_hz, [getattr(cell, f'paper_{scheme}') for cell in mine],
                           markeredgecolor=colour, **_PAPER_MARK)
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        percent_axis(panels[0])
        _ours_against_published(summary, cells)
        handles: list[Artist] = [
            Line2D([], [], color=scheme_colour(scheme), marker='o', markersize=3.6, label=label)
            for scheme, label in _SCHEMES]
        handles.append(Line2D([], [], markeredgecolor=INK, label='paper', **_PAPER_MARK))
        if mark_winners and not all(cell.same_winner for cell in cells):
            handles.append(
                Patch(color=INK, alpha=_BAND_ALPHA, linewidth=0, label='another winner'))
        head(figure, handles, title)
    return figure


def harmonics_figure(curves: Sequence[HarmonicsCurve]) -> Figure:
    """
    Draw the error over the number of harmonics of the feedforward.

    Parameters
    ----------
    curves : sequence of HarmonicsCurve
        One a panel, at least one.

    Returns
    -------
    Figure
        Predicted as lines, measured as dots, the chosen number ringed and that of the paper as a
        dashed upright.

    Raises
    ------
    ValueError
        If there is no curve, or the chosen number is none of the harmonics.

    """
    if not curves:
        raise ValueError('curves is empty, a figure needs at least one curve')
    with house_style():
        figure, panels, _ = panel_grid(
            len(curves), x_label='harmonics up to m', y_label='NRMSE (%)')
        for panel, curve in zip(panels, curves, strict=True):
            harmonics = np.asarray(curve.harmonics)
            predicted = np.asarray(curve.predicted_percent, dtype=np.float64)
            measured = np.asarray(curve.measured_percent, dtype=np.float64)
            if curve.chosen not in harmonics:
                raise ValueError(
                    f'{curve.label}: chosen is {curve.chosen}, it must be one of '
                    f'{harmonics.tolist()}')
            panel.axvline(paper.HARMONICS, color=INK, linewidth=0.8, linestyle='dashed', alpha=0.6)
            panel.plot(harmonics, predicted, color=SERIES[0])
            panel.plot(harmonics, measured, color=SERIES[3], linestyle='none', marker='o',
                       markersize=4.0)
            at = harmonics == curve.chosen
            panel.plot(harmonics[at], predicted[at], **_CHOSEN_MARK)
            panel.set_title(curve.label, loc='left', fontsize=9.5, pad=3)
            panel.set_title(f'm = {curve.chosen}', loc='right', fontsize=9.5, fontweight='bold',
                            pad=3)
        percent_axis(panels[0])
        head(figure, [
            Line2D([], [], color=SERIES[0], label='predicted'),
            Line2D([], [], color=SERIES[3], linestyle='none', marker='o', markersize=4.0,
                   label='measured'),
            Line2D([], [], label='chosen', **_CHOSEN_MARK),
            Line2D([], [], color=INK, linewidth=0.8, linestyle='dashed', alpha=0.6,
                   label=f'm = {paper.HARMONICS}, as in the paper')])
    return figure


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


def _ours_against_published(panel: Axes, cells: Sequence[TableCell]) -> None:
    for scheme, _ in _SCHEMES:
        panel.plot([getattr(cell, f'paper_{scheme}') for cell in cells],
                   [getattr(cell, scheme) for cell in cells], linestyle='none', marker='o',
                   markersize=3.2, color=scheme_colour(scheme), alpha=0.75, markeredgewidth=0)
    errors = np.array([cell[2:] for cell in cells])
    limits = 0.85 * float(errors.min()), 1.18 * float(errors.max())
    panel.plot(limits, limits, color=INK, linewidth=0.8)
    for which in ('x', 'y'):
        percent_axis(panel, which)
    panel.set_xlim(limits)
    panel.set_ylim(limits)
    panel.set_xlabel('published (%)')
    panel.set_ylabel('ours (%)')
    panel.set_title('every cell', loc='left', fontsize=9.5, pad=3)


def _least_step(values: Sequence[float]) -> float:
    return min((high - low for low, high in pairwise(values)), default=100.0)
