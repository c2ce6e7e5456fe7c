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

"""Draws NRMSE over frequency beside the published numbers (Table 4 in Liu 2015)."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from piezo_ros.report.figures.panels import add_head, panel_grid, percent_axis
from piezo_ros.report.figures.style import (
    INK,
    SCHEME_MARKERS,
    figure_style,
    scheme_colour,
    scheme_line_style,
)
from piezo_ros.report.labels import scheme_label
from piezo_ros.report.score import ScoredRun

__all__ = ['TableCell', 'nrmse_figure', 'table_4_figure']

_BAND_ALPHA: Final = 0.13
_TABLE_4_SCHEMES: Final = ('ff', 'fbff')
# Any: Matplotlib's types do not accept a dictionary of settings.
_PAPER_MARK: Final[Any] = {'linestyle': 'none', 'markersize': 7.0, 'markerfacecolor': 'none'}


class TableCell(NamedTuple):
    """One condition of Table 4 in Liu 2015: our errors and the published ones, percent."""

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


def nrmse_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw the NRMSE of runs over frequency.

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one waveform at several frequencies.

    Returns
    -------
    Figure
        One panel for each amplitude, at most three in a row; the runs as lines, the published
        numbers as open marks.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    amplitudes = sorted({run.amplitude_um for run in runs})
    with figure_style():
        figure, panels, _ = panel_grid(
            len(amplitudes), x_label='frequency (Hz)', y_label='NRMSE (%)')
        for panel, amplitude_um in zip(panels, amplitudes, strict=True):
            _draw_runs(panel, [run for run in runs if run.amplitude_um == amplitude_um])
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        # The error of FB is ten times that of the others: a logarithmic axis shows all of them.
        percent_axis(panels[0])
        add_head(figure, _nrmse_handles(runs))
    return figure


def table_4_figure(
    cells: Sequence[TableCell], *, title: str, mark_winners: bool = True,
) -> Figure:
    """
    Draw all conditions of Table 4 in Liu 2015, ours and the published ones.

    Parameters
    ----------
    cells : sequence of TableCell
        At least one.
    title : str
        Heading.
    mark_winners : bool, optional
        Whether to shade the conditions in which another scheme than the published one is better.

    Returns
    -------
    Figure
        One panel for each amplitude, our errors as lines and the published ones as open marks. A
        last panel plots our errors over the published ones.

    Raises
    ------
    ValueError
        If there is no cell.

    """
    if not cells:
        raise ValueError('cells is empty, a figure needs at least one cell')
    amplitudes = sorted({cell.amplitude_um for cell in cells})
    with figure_style():
        figure, panels, summary = panel_grid(
            len(amplitudes), x_label='frequency (Hz)', y_label='NRMSE (%)', spare=True,
            title=title)
        assert summary is not None
        half_width = 0.35 * _least_step(sorted({cell.frequency_hz for cell in cells}))
        for panel, amplitude_um in zip(panels, amplitudes, strict=True):
            selected = sorted(cell for cell in cells if cell.amplitude_um == amplitude_um)
            for cell in selected:
                if mark_winners and not cell.same_winner:
                    panel.axvspan(cell.frequency_hz - half_width, cell.frequency_hz + half_width,
                                  color=INK, alpha=_BAND_ALPHA, linewidth=0)
            frequency_hz = [cell.frequency_hz for cell in selected]
            for scheme in _TABLE_4_SCHEMES:
                colour = scheme_colour(scheme)
                panel.plot(frequency_hz, [getattr(cell, scheme) for cell in selected],
                           **_own_mark(scheme))
                panel.plot(frequency_hz, [getattr(cell, f'paper_{scheme}') for cell in selected],
                           markeredgecolor=colour, marker=_marker(scheme), **_PAPER_MARK)
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        percent_axis(panels[0])
        _ours_against_published(summary, cells)
        handles = _scheme_handles(_TABLE_4_SCHEMES)
        handles.append(_paper_handle())
        if mark_winners and not all(cell.same_winner for cell in cells):
            handles.append(
                Patch(color=INK, alpha=_BAND_ALPHA, linewidth=0, label='another winner'))
        add_head(figure, handles, title)
    return figure


def _marker(scheme: str) -> str:
    return SCHEME_MARKERS.get(scheme, 'v')


def _own_mark(scheme: str) -> dict[str, Any]:
    return {
        'color': scheme_colour(scheme), 'linestyle': scheme_line_style(scheme),
        'marker': _marker(scheme), 'markersize': 3.6}


def _schemes(runs: Sequence[ScoredRun]) -> list[str]:
    return list(dict.fromkeys(run.scheme for run in runs))


def _draw_runs(panel: Axes, runs: Sequence[ScoredRun]) -> None:
    for scheme in _schemes(runs):
        selected = sorted((run for run in runs if run.scheme == scheme),
                          key=lambda run: run.frequency_hz)
        colour = scheme_colour(scheme)
        frequency_hz = np.array([run.frequency_hz for run in selected])
        panel.plot(frequency_hz, [run.nrmse_percent for run in selected], **_own_mark(scheme))
        panel.plot(
            frequency_hz, np.array([run.paper_nrmse_percent for run in selected], dtype=float),
            markeredgecolor=colour, marker=_marker(scheme), **_PAPER_MARK)


def _nrmse_handles(runs: Sequence[ScoredRun]) -> list[Artist]:
    handles = _scheme_handles(_schemes(runs))
    if any(run.paper_nrmse_percent is not None for run in runs):
        handles.append(_paper_handle())
    return handles


def _scheme_handles(schemes: Sequence[str]) -> list[Artist]:
    return [
        Line2D([], [], label=scheme_label(scheme), **_own_mark(scheme)) for scheme in schemes]


def _paper_handle() -> Artist:
    return Line2D([], [], markeredgecolor=INK, marker='o', label='paper', **_PAPER_MARK)


def _ours_against_published(panel: Axes, cells: Sequence[TableCell]) -> None:
    for scheme in _TABLE_4_SCHEMES:
        panel.plot([getattr(cell, f'paper_{scheme}') for cell in cells],
                   [getattr(cell, scheme) for cell in cells], linestyle='none',
                   marker=_marker(scheme), markersize=3.2, color=scheme_colour(scheme),
                   alpha=0.75, markeredgewidth=0)
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
