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

"""Draws tracking over time: desired and measured displacement, and the errors."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import INK, figure_style, scheme_colour, scheme_line_style
from piezo_ros.report.labels import run_label
from piezo_ros.report.score import ScoredRun

__all__ = ['error_figure', 'error_limits_um', 'run_line_style', 'tracking_figure']

_HEADROOM: Final = 1.08
# The rows of errors have one scale as long as the smallest error fills a quarter of it.
_COMMON_SCALE_RATIO: Final = 4.0


def tracking_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw desired and measured displacement, and below them the errors (Fig. 11 in Liu 2015).

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one reference, over the scored window.

    Returns
    -------
    Figure
        Two panels over a common time axis.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 4.9))
        top, bottom = figure.subplots(
            2, 1, sharex=True,
            gridspec_kw={'height_ratios': (3, 2), 'hspace': 0.12, 'left': 0.1, 'right': 0.985,
                         'top': 0.925, 'bottom': 0.105})
        # The reference is a broad pale band: the measured lines would hide a thin line.
        top.plot(runs[0].window_ms, runs[0].reference_um, color=INK, alpha=0.22, linewidth=4.5,
                 solid_joinstyle='round', label='desired')
        for run in runs:
            style = run_line_style(run, runs)
            colour, label = scheme_colour(run.scheme), run_label(run, runs)
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
        One row for each run over a common time axis, scaled by `error_limits_um`.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    margin_in, row_in = (0.12, 0.52), 1.25
    height_in = row_in * len(runs) + sum(margin_in)
    with figure_style():
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
                f'{run_label(run, runs)}: NRMSE {run.nrmse_percent:.2f} %, '
                f'largest {run.max_error_um:.3f} µm',
                loc='left', color=colour, fontsize=9.5, fontweight='bold', pad=4)
        rows[-1].set_xlabel('time (ms)')
        rows[-1].set_xlim(0, runs[0].window_ms[-1])
        figure.align_ylabels()
    return figure


def error_limits_um(runs: Sequence[ScoredRun]) -> list[float]:
    """
    Return the limits of the error axes of `error_figure`, one for each row.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs of the rows.

    Returns
    -------
    list of float
        Largest shown |error|, micrometres: the same for all rows if their largest errors differ by
        at most a factor of four, otherwise each its own.

    """
    largest = [run.max_error_um for run in runs]
    if max(largest) <= _COMMON_SCALE_RATIO * min(largest):
        largest = [max(largest)] * len(runs)
    return [_HEADROOM * value for value in largest]


def _symmetric(axes: Axes, limit: float) -> None:
    if limit > 0.0:
        axes.set_ylim(-limit, limit)


def run_line_style(run: ScoredRun, runs: Sequence[ScoredRun]) -> str:
    """Return the line style of a run: that of its scheme, another one for a second run of it."""
    earlier = sum(other.scheme == run.scheme for other in runs[:runs.index(run)])
    return scheme_line_style(run.scheme, earlier)
