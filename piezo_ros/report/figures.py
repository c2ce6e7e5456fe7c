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

"""The pictures of the report: tracking, errors, hysteresis, NRMSE and the loop itself."""

import math
from collections.abc import Sequence
from importlib import resources
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezo_ros.report.comparison import scheme_label, series_label
from piezo_ros.report.layout import WIDTH_IN, head, panel_grid, percent_axis
from piezo_ros.report.rendering import INK, house_style, scheme_colour
from piezo_ros.report.score import ScoredRun

__all__ = [
    'error_figure',
    'error_limits_um',
    'hysteresis_figure',
    'loop_picture',
    'nrmse_figure',
    'tracking_figure',
]

_HEADROOM: Final = 1.08
# Rows of errors keep one scale while the smallest still fills a quarter of it.
_COMMON_SCALE_RATIO: Final = 4.0
_LINE_STYLES: Final = ('solid', 'dashed', 'dotted', 'dashdot')


def tracking_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw the desired and the measured displacement, the errors below (Fig. 11 in Liu 2015).

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one reference, over the scored window.

    Returns
    -------
    Figure
        Two panels over one time axis.

    """
    _at_least_one(runs)
    with house_style():
        figure = Figure(figsize=(WIDTH_IN, 4.9))
        top, bottom = figure.subplots(
            2, 1, sharex=True,
            gridspec_kw={'height_ratios': (3, 2), 'hspace': 0.12, 'left': 0.1, 'right': 0.985,
                         'top': 0.925, 'bottom': 0.105})
        # The reference is a broad pale band: four thin lines on each other would hide it.
        top.plot(runs[0].window_ms, runs[0].reference_um, color=INK, alpha=0.22, linewidth=4.5,
                 solid_joinstyle='round', label='desired')
        for run in runs:
            style = _line_style(run, runs)
            colour, label = scheme_colour(run.scheme), series_label(run, runs)
            top.plot(run.window_ms, run.displacement_um, color=colour, linestyle=style, label=label)
            bottom.plot(run.window_ms, run.error_um, color=colour, linestyle=style, linewidth=1.1)
        top.set_ylabel('displacement (µm)')
        bottom.set_ylabel('error (µm)')
        bottom.set_xlabel('time (ms)')
        bottom.set_xlim(0, runs[0].window_ms[-1])
        limit = _HEADROOM * max(run.max_error_um for run in runs)
        _symmetric(bottom, limit)
        top.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=len(runs) + 1, borderpad=0,
                   borderaxespad=0.35, handlelength=1.6, columnspacing=1.8)
        figure.align_ylabels()
    return figure


def error_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw the tracking error of each run in a row of its own.

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one reference, over the scored window.

    Returns
    -------
    Figure
        One row a run over one time axis, scaled by `error_limits_um`.

    """
    _at_least_one(runs)
    margin_in, row_in = (0.12, 0.52), 1.25
    height_in = row_in * len(runs) + sum(margin_in)
    with house_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        rows = figure.subplots(
            len(runs), 1, sharex=True, squeeze=False,
            gridspec_kw={'hspace': 0.34, 'left': 0.1, 'right': 0.985,
                         'top': 1 - (margin_in[0] + 0.16) / height_in,
                         'bottom': margin_in[1] / height_in})[:, 0]
        for row, run, limit in zip(rows, runs, error_limits_um(runs), strict=True):
            colour = scheme_colour(run.scheme)
            row.plot(run.window_ms, run.error_um, color=colour, linewidth=1.1)
            row.set_ylabel('error (µm)')
            row.locator_params(axis='y', nbins=4)
            row.axhline(0.0, color=INK, linewidth=0.6)
            _symmetric(row, limit)
            row.set_title(
                f'{series_label(run, runs)}: NRMSE {run.nrmse_percent:.2f} %, '
                f'largest {run.max_error_um:.3f} µm',
                loc='left', color=colour, fontsize=9.5, fontweight='bold', pad=4)
        rows[-1].set_xlabel('time (ms)')
        rows[-1].set_xlim(0, runs[0].window_ms[-1])
        figure.align_ylabels()
    return figure


def error_limits_um(runs: Sequence[ScoredRun]) -> list[float]:
    """
    Return the half height of each row of `error_figure`.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The rows.

    Returns
    -------
    list of float
        Micrometres: the same for all while their largest errors lie within a factor of four,
        otherwise each its own.

    """
    largest = [run.max_error_um for run in runs]
    if max(largest) <= _COMMON_SCALE_RATIO * min(largest):
        largest = [max(largest)] * len(runs)
    return [_HEADROOM * value for value in largest]


def hysteresis_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw displacement over voltage, one small panel a run (in the manner of Fig. 5 in Liu 2015).

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs, over the scored window.

    Returns
    -------
    Figure
        Panels with common axes, at most four in a row.

    """
    _at_least_one(runs)
    columns = min(len(runs), 4)
    rows = math.ceil(len(runs) / columns)
    panel_in = min(2.3, (WIDTH_IN - 0.75) / columns)
    width_in, height_in = 0.75 + panel_in * columns, 0.75 + panel_in * rows
    with house_style():
        figure = Figure(figsize=(width_in, height_in))
        panels = figure.subplots(
            rows, columns, sharex=True, sharey=True, squeeze=False,
            gridspec_kw={'left': 0.62 / width_in, 'right': 1 - 0.1 / width_in, 'wspace': 0.12,
                         'hspace': 0.22, 'top': 1 - 0.25 / height_in,
                         'bottom': 0.5 / height_in}).ravel()
        for panel, run in zip(panels, runs, strict=False):
            colour = scheme_colour(run.scheme)
            panel.plot(run.voltage_v, run.displacement_um, color=colour, linewidth=1.0)
            panel.set_title(series_label(run, runs), loc='left', color=colour, fontsize=9.5,
                            fontweight='bold', pad=4)
        for panel in panels[len(runs):]:
            panel.set_visible(False)
        for panel in panels[max(0, len(runs) - columns):len(runs)]:
            panel.set_xlabel('voltage (V)')
            panel.xaxis.set_tick_params(labelbottom=True)
        for panel in panels[::columns]:
            panel.set_ylabel('displacement (µm)')
    return figure


def nrmse_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw NRMSE over frequency beside the published numbers (Table 4 in Liu 2015).

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one waveform at several frequencies.

    Returns
    -------
    Figure
        One panel an amplitude, at most three in a row; ours as lines, the paper's as open circles.

    """
    _at_least_one(runs)
    amplitudes = sorted({run.amplitude_um for run in runs})
    with house_style():
        figure, panels, _ = panel_grid(
            len(amplitudes), x_label='frequency (Hz)', y_label='NRMSE (%)')
        for panel, amplitude_um in zip(panels, amplitudes, strict=True):
            _nrmse_panel(panel, [run for run in runs if run.amplitude_um == amplitude_um])
            panel.set_title(f'{amplitude_um:g} µm', loc='left', fontsize=9.5, pad=3)
        # FB alone is ten times worse than the others: only a logarithmic axis shows all three.
        percent_axis(panels[0])
        head(figure, _nrmse_handles(runs))
    return figure


def loop_picture() -> str:
    """
    Return the block diagram of the loop with the topics on its arrows.

    Returns
    -------
    str
        An ``<svg>`` element that takes its ink from the page (``currentColor``).

    """
    return resources.files('piezo_ros.report').joinpath('loop.svg').read_text('utf-8').strip()


def _at_least_one(runs: Sequence[ScoredRun]) -> None:
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')


def _symmetric(axes: Axes, limit: float) -> None:
    if limit > 0.0:
        axes.set_ylim(-limit, limit)


def _line_style(run: ScoredRun, runs: Sequence[ScoredRun]) -> str:
    """Return the line style that tells a run from earlier ones of its scheme, hence colour."""
    earlier = sum(other.scheme == run.scheme for other in runs[:runs.index(run)])
    return _LINE_STYLES[earlier % len(_LINE_STYLES)]


def _schemes(runs: Sequence[ScoredRun]) -> list[str]:
    return list(dict.fromkeys(run.scheme for run in runs))


def _nrmse_panel(panel: Axes, runs: Sequence[ScoredRun]) -> None:
    for scheme in _schemes(runs):
        mine = sorted((run for run in runs if run.scheme == scheme),
                      key=lambda run: run.frequency_hz)
        colour = scheme_colour(scheme)
        frequency_hz = np.array([run.frequency_hz for run in mine])
        panel.plot(frequency_hz, [run.nrmse_percent for run in mine], color=colour, marker='o',
                   markersize=3.6)
        panel.plot(frequency_hz, np.array([run.paper_nrmse_percent for run in mine], dtype=float),
                   linestyle='none', marker='o', markersize=7.0, markerfacecolor='none',
                   markeredgecolor=colour)


def _nrmse_handles(runs: Sequence[ScoredRun]) -> list[Artist]:
    handles: list[Artist] = [
        Line2D([], [], color=scheme_colour(scheme), marker='o', markersize=3.6,
               label=scheme_label(scheme))
        for scheme in _schemes(runs)]
    if any(run.paper_nrmse_percent is not None for run in runs):
        handles.append(Line2D([], [], linestyle='none', marker='o', markersize=7.0,
                              markerfacecolor='none', markeredgecolor=INK, label='paper'))
    return handles
