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
"""Draws the voltage of runs over time, with the rails and the samples at which it is limited."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from piezo_ros.report.amplifier_use import limited_samples
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import INK, SERIES, figure_style, scheme_colour
from piezo_ros.report.labels import run_label
from piezo_ros.report.score import ScoredRun

__all__ = [
    'RAIL_COLOUR', 'SLEW_COLOUR', 'LimitedVoltage', 'limited_voltage', 'voltage_figure',
    'voltage_title',
]

SLEW_COLOUR: Final = SERIES[3]
RAIL_COLOUR: Final = SERIES[2]
# A rail that is farther away than this share of the range of the voltage is told in words alone.
_NEAR_SHARE: Final = 0.35
_MS_PER_S: Final = 1e3


class LimitedVoltage(NamedTuple):
    """
    Where the amplifier limits a voltage, and the rails near it.

    Attributes
    ----------
    slewing_v, at_rails_v : ndarray, shape (N,)
        The voltage where the amplifier slews, and where it is at its rails, volts; NaN elsewhere.
    rails_v : tuple of float
        The rails that a panel around the voltage shows, volts.

    """

    slewing_v: NDArray[np.float64]
    at_rails_v: NDArray[np.float64]
    rails_v: tuple[float, ...]


def limited_voltage(run: ScoredRun) -> LimitedVoltage:
    """Return where the amplifier limits the voltage of a run; nowhere if its limits are unknown."""
    voltage_v, limits = run.voltage_v, run.setup.limits
    if limits is None or voltage_v.size < 2:
        nowhere = np.full_like(voltage_v, np.nan)
        return LimitedVoltage(nowhere, nowhere, ())
    at_rails, slewing = limited_samples(
        voltage_v, limits, float(run.time_s[1] - run.time_s[0]))
    low, high = float(voltage_v.min()), float(voltage_v.max())
    reach = _NEAR_SHARE * (high - low)
    return LimitedVoltage(
        np.where(slewing, voltage_v, np.nan), np.where(at_rails, voltage_v, np.nan),
        tuple(rail for rail in (limits.minimum_v, limits.maximum_v)
              if low - reach <= rail <= high + reach))


def voltage_title(run: ScoredRun, among: Sequence[ScoredRun]) -> str:
    """Return the heading of a run's voltage: its name, range, rails and slew limit."""
    words = [f'{run.voltage_v.min():.3g} … {run.voltage_v.max():.3g} V']
    if run.setup.limits is None:
        words.append('limits of the amplifier not known')
    else:
        limits = run.setup.limits
        words.append(f'rails {limits.minimum_v:.4g} and {limits.maximum_v:.4g} V')
        if limits.slew_limit_v_per_s:
            words.append(f'slew limit {limits.slew_limit_v_per_s / _MS_PER_S:.4g} V/ms')
    numbers = ', '.join(words).replace('-', '\N{MINUS SIGN}')
    return f'{run_label(run, among)}: {numbers}'


def voltage_figure(runs: Sequence[ScoredRun]) -> Figure:
    """
    Draw the voltage at the input of the amplifier, one row for each run.

    Parameters
    ----------
    runs : sequence of ScoredRun
        Runs of one reference, over the scored window.

    Returns
    -------
    Figure
        Rows over a common time axis. Broad lines mark the samples at which the amplifier slews or
        is at a rail; dashed lines are the rails that are near.

    Raises
    ------
    ValueError
        If there is no run.

    """
    if not runs:
        raise ValueError('runs is empty, a figure needs at least one run')
    margin_in, row_in = (0.3, 0.52), 1.35
    height_in = row_in * len(runs) + sum(margin_in)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        rows = figure.subplots(
            len(runs), 1, sharex=True, squeeze=False,
            gridspec_kw={'hspace': 0.4, 'left': 0.1, 'right': 0.985,
                         'top': 1 - margin_in[0] / height_in,
                         'bottom': margin_in[1] / height_in})[:, 0]
        for row, run in zip(rows, runs, strict=True):
            limited = limited_voltage(run)
            for values, colour, label in (
                    (limited.slewing_v, SLEW_COLOUR, 'slewing'),
                    (limited.at_rails_v, RAIL_COLOUR, 'at a rail')):
                if np.isfinite(values).any():
                    row.plot(run.window_ms, values, color=colour, linewidth=5.0, alpha=0.45,
                             solid_capstyle='butt', marker='|', markersize=5.0, label=label)
            row.plot(run.window_ms, run.voltage_v, color=scheme_colour(run.scheme), linewidth=1.1)
            for rail_v in limited.rails_v:
                row.axhline(rail_v, color=INK, linewidth=0.9, linestyle='dashed')
            row.set_ylabel('voltage (V)')
            row.locator_params(axis='y', nbins=4)
            row.set_title(voltage_title(run, runs), loc='left', fontsize=9.5, pad=4)
            if row.get_legend_handles_labels()[1]:
                row.legend(loc='upper right', fontsize=8.5, handlelength=1.2, borderpad=0.1)
        rows[-1].set_xlabel('time (ms)')
        rows[-1].set_xlim(0, runs[0].window_ms[-1])
        figure.align_ylabels()
    return figure
