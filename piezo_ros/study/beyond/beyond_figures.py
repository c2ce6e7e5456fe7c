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

"""Pictures of planned and learned scans: errors by cell and by run, prediction, certificate."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from piezo_ros.report.figures.panels import WIDTH_IN, panel_grid, percent_axis
from piezo_ros.report.figures.style import (
    FAINT,
    INK,
    MARKERS,
    SCHEME_COLOURS,
    SERIES,
    figure_style,
)
from piezo_ros.study.beyond.beyond_results import CellResult

__all__ = ['bars_figure', 'certificate_figure', 'learning_figure', 'prediction_figure']

_COLOURS: Final = {
    'as published': FAINT, 're-identified': SERIES[4], 'planned': SERIES[0],
    'learned': SCHEME_COLOURS['fbff']}
_PAPER_MARK: Final[Any] = {
    'linestyle': 'none', 'marker': 'o', 'markersize': 5.5, 'markerfacecolor': 'none',
    'markeredgecolor': INK}
_BEST_MARK: Final[Any] = {
    'linestyle': 'none', 'marker': '_', 'markersize': 9.0, 'markeredgecolor': INK,
    'markeredgewidth': 1.5}
_GROUP: Final = 0.84  # of the distance between groups of bars


def _finish(figure: Figure, handles: list[Artist]) -> None:
    """Put a compact legend above the panels, and make room for percentages below 0.1."""
    width_in = float(figure.get_size_inches()[0])
    wide = width_in >= WIDTH_IN
    figure.legend(
        handles=handles, loc='upper left', ncol=len(handles) if wide else 3, borderpad=0,
        borderaxespad=0.4, bbox_to_anchor=(0.5 / width_in, 1.0), handlelength=1.3,
        handletextpad=0.5, columnspacing=1.2, fontsize=8.5)
    for panel in figure.axes:
        panel.yaxis.labelpad = 0.5
        panel.tick_params(labelsize=8.5, pad=2)


def _by_amplitude(cells: Sequence[CellResult]) -> dict[float, list[CellResult]]:
    rows: dict[float, list[CellResult]] = {}
    for cell in sorted(cells, key=lambda cell: (cell.amplitude_um, cell.frequency_hz)):
        rows.setdefault(cell.amplitude_um, []).append(cell)
    return rows


def bars_figure(cells: Sequence[CellResult]) -> Figure:
    """
    Draw the measured errors of every cell as bars, one panel for each amplitude.

    Parameters
    ----------
    cells : sequence of CellResult
        At least one.

    """
    rows = _by_amplitude(cells)
    with figure_style():
        figure, panels, _ = panel_grid(
            len(rows), x_label='frequency (Hz)', y_label='NRMSE (%)')
        width = _GROUP / len(_COLOURS)
        for panel, (amplitude_um, row) in zip(panels, rows.items(), strict=True):
            place = np.arange(len(row))
            values = (
                [cell.published_percent for cell in row],
                [cell.identified_percent for cell in row],
                [cell.scan.runs[0].measured_percent for cell in row],
                [cell.scan.learned.measured_percent for cell in row])
            for number, (colour, errors) in enumerate(
                    zip(_COLOURS.values(), values, strict=True)):
                panel.bar(
                    place + (number - 1.5) * width, errors, width, color=colour, linewidth=0)
            panel.plot(place, [cell.paper_percent for cell in row], **_PAPER_MARK)
            panel.plot(
                place + 1.5 * width, [cell.best_known_percent for cell in row], **_BEST_MARK)
            panel.set_xticks(place, [f'{cell.frequency_hz:g}' for cell in row])
            panel.grid(visible=False, axis='x')
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        percent_axis(panels[0])
        panels[0].set_ylim(bottom=0.02)
        _finish(figure, [
            *(Patch(color=colour, linewidth=0, label=label)
              for label, colour in _COLOURS.items()),
            Line2D([], [], label='paper', **_PAPER_MARK),
            Line2D([], [], label='best known, true', **_BEST_MARK)])
    return figure


def learning_figure(cells: Sequence[CellResult]) -> Figure:
    """
    Draw the error over the runs, one panel for each amplitude.

    Parameters
    ----------
    cells : sequence of CellResult
        At least one.

    """
    rows = _by_amplitude(cells)
    frequencies_hz = sorted({cell.frequency_hz for cell in cells})
    looks = dict(zip(frequencies_hz, zip(SERIES, MARKERS, strict=True), strict=False))
    with figure_style():
        figure, panels, _ = panel_grid(len(rows), x_label='run', y_label='true NRMSE (%)')
        for panel, (amplitude_um, row) in zip(panels, rows.items(), strict=True):
            for cell in row:
                scan, (colour, marker) = cell.scan, looks.get(cell.frequency_hz, (INK, 'x'))
                errors = [run.true_percent for run in scan.runs]
                panel.plot(np.arange(len(errors)), errors, color=colour, marker=marker,
                           markersize=3.0)
                panel.plot(scan.best, errors[scan.best], linestyle='none', marker=marker,
                           markersize=7.5, markerfacecolor='none', markeredgecolor=colour)
                panel.axhline(cell.best_known_percent, color=colour, linewidth=0.8,
                              linestyle='dotted')
            panel.set_xticks(range(max(len(cell.scan.runs) for cell in row)))
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        percent_axis(panels[0])
        _finish(figure, [
            *(Line2D([], [], color=colour, marker=marker, markersize=3.0, label=f'{f:g} Hz')
              for f, (colour, marker) in looks.items()),
            Line2D([], [], color=INK, linewidth=0.8, linestyle='dotted', label='best known')])
    return figure


def prediction_figure(cells: Sequence[CellResult]) -> Figure:
    """
    Draw what the plans predicted over what their first runs measured.

    Parameters
    ----------
    cells : sequence of CellResult
        At least one.

    """
    rows = _by_amplitude(cells)
    with figure_style():
        figure, (panel,), _ = panel_grid(
            1, x_label='measured in the first run (%)', y_label='predicted by the plan (%)')
        for (_, row), colour, marker in zip(rows.items(), SERIES, MARKERS, strict=False):
            measured = np.array([cell.scan.runs[0].measured_percent for cell in row])
            predicted = np.array([cell.scan.plan.measured_nrmse_percent for cell in row])
            highest = np.array([cell.scan.plan.highest_nrmse_percent for cell in row])
            panel.errorbar(
                measured, predicted, [np.zeros(len(row)), highest - predicted], linestyle='none',
                marker=marker, markersize=4.0, color=colour, elinewidth=0.9)
        largest = 1.15 * max(cell.scan.runs[0].measured_percent for cell in cells)
        least = 0.85 * min(cell.scan.plan.measured_nrmse_percent for cell in cells)
        panel.plot([least, largest], [least, largest], color=INK, linewidth=0.8)
        for which in ('x', 'y'):
            percent_axis(panel, which)
        _finish(figure, [
            Line2D([], [], color=colour, linestyle='none', marker=marker, markersize=4.0,
                   label=f'{amplitude_um:g} µm')
            for amplitude_um, colour, marker in zip(rows, SERIES, MARKERS, strict=False)])
    return figure


def certificate_figure(cells: Sequence[CellResult]) -> Figure:
    """
    Draw the certificate of every cell, and the contraction with the true slope.

    Parameters
    ----------
    cells : sequence of CellResult
        At least one.

    """
    rows = _by_amplitude(cells)
    with figure_style():
        figure, (panel,), _ = panel_grid(1, x_label='frequency (Hz)', y_label='gamma')
        for (_, row), colour, marker in zip(rows.items(), SERIES, MARKERS, strict=False):
            frequency_hz = [cell.frequency_hz for cell in row]
            panel.plot(frequency_hz, [cell.scan.plan.certificate.gamma for cell in row],
                       color=colour, marker=marker, markersize=4.0)
            panel.plot(frequency_hz, [cell.scan.true_gamma for cell in row], color=colour,
                       linestyle='none', marker='x', markersize=4.5)
        panel.axhline(1.0, color=INK, linewidth=0.8, linestyle='dashed')
        panel.set_ylim(bottom=0.0)
        _finish(figure, [
            *(Line2D([], [], color=colour, marker=marker, markersize=4.0,
                     label=f'{amplitude_um:g} µm')
              for amplitude_um, colour, marker in zip(rows, SERIES, MARKERS, strict=False)),
            Line2D([], [], color=INK, linestyle='none', marker='x', markersize=4.5,
                   label='true')])
    return figure
