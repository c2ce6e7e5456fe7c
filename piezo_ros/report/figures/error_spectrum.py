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
"""Draws the tracking error of runs by harmonic of the reference."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from piezo_ros.report.error_harmonics import ErrorHarmonics, error_harmonics
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import (
    SCHEME_MARKERS,
    figure_style,
    scheme_colour,
)
from piezo_ros.report.figures.tracking import run_line_style
from piezo_ros.report.labels import run_label
from piezo_ros.report.score import ScoredRun

__all__ = ['NM_PER_UM', 'error_spectrum_figure', 'run_error_harmonics']

NM_PER_UM = 1e3


def run_error_harmonics(run: ScoredRun) -> ErrorHarmonics:
    """Return the tracking error of a run by harmonic, over the scored window."""
    return error_harmonics(
        run.error_um, run.frequency_hz, float(run.time_s[1] - run.time_s[0]))


def error_spectrum_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw the amplitude of the error at each harmonic of the reference.

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one reference, over the scored window.

    Returns
    -------
    Figure
        Nanometres on a logarithmic axis over the number of the harmonic.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 3.2))
        axes = figure.subplots(gridspec_kw={
            'left': 0.1, 'right': 0.985, 'top': 0.895, 'bottom': 0.155})
        for run in runs:
            found = run_error_harmonics(run)
            axes.plot(
                found.harmonics, NM_PER_UM * found.amplitude_um, color=scheme_colour(run.scheme),
                linestyle=run_line_style(run, runs), linewidth=0.9, markersize=4.2,
                marker=SCHEME_MARKERS.get(run.scheme, 'v'), label=run_label(run, runs))
        axes.set_yscale('log', nonpositive='mask')
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel('harmonic of the reference')
        axes.set_ylabel('amplitude of the error (nm)')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=len(runs), borderpad=0,
                    borderaxespad=0.35, handlelength=2.6, columnspacing=1.8)
    return figure
