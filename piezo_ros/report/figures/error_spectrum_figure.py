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
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from piezo_ros.report.error_harmonics import ErrorHarmonics, error_harmonics
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import (
    SCHEME_MARKERS,
    figure_style,
    scheme_colour,
)
from piezo_ros.report.labels import run_label
from piezo_ros.report.score import ScoredRun

__all__ = ['NM_PER_UM', 'error_spectrum_figure', 'harmonic_places', 'run_error_harmonics']

NM_PER_UM: Final = 1e3
_SPREAD: Final = 0.6


def run_error_harmonics(run: ScoredRun) -> ErrorHarmonics:
    """Return the tracking error of a run by harmonic, over the scored window."""
    return error_harmonics(
        run.error_um, run.frequency_hz, float(run.time_s[1] - run.time_s[0]))


def harmonic_places(
    found: ErrorHarmonics, number: int, count: int,
) -> NDArray[np.float64]:
    """
    Return the abscissae of the harmonics of one of several runs, beside each other.

    Parameters
    ----------
    found : ErrorHarmonics
        The error of the run.
    number, count : int
        Number of the run from 0, and how many there are.

    Returns
    -------
    ndarray, shape (K,)
        Each harmonic with a small offset.

    """
    return np.asarray(found.harmonics + _SPREAD * ((number + 0.5) / count - 0.5))


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
        for number, run in enumerate(runs):
            found = run_error_harmonics(run)
            axes.plot(
                harmonic_places(found, number, len(runs)), NM_PER_UM * found.amplitude_um,
                color=scheme_colour(run.scheme), linestyle='none', markersize=4.4,
                marker=SCHEME_MARKERS.get(run.scheme, 'v'), label=run_label(run, runs),
                markerfacecolor='none' if number % 2 else None)
        axes.set_yscale('log', nonpositive='mask')
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel('harmonic of the reference')
        axes.set_ylabel('amplitude of the error (nm)')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=len(runs), borderpad=0,
                    borderaxespad=0.35, handlelength=1.0, columnspacing=1.8)
    return figure
