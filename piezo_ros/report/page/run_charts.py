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
"""The figures of scored runs as interactive charts."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.report.figures.error_spectrum_figure import (
    NM_PER_UM,
    harmonic_places,
    run_error_harmonics,
)
from piezo_ros.report.figures.style import INK, scheme_colour
from piezo_ros.report.figures.tracking_figure import error_limits_um, run_line_style
from piezo_ros.report.figures.voltage_figure import (
    RAIL_COLOUR,
    SLEW_COLOUR,
    limited_voltage,
    voltage_title,
)
from piezo_ros.report.labels import run_label
from piezo_ros.report.page.chart import Line, Panel, Trace
from piezo_ros.report.page.curve_panel import Curve, CurvePanel
from piezo_ros.report.score import ScoredRun

__all__ = [
    'error_panels',
    'hysteresis_panels',
    'spectrum_panels',
    'starts_of',
    'tracking_panels',
    'voltage_panels',
]

_TIME: Final = 'time (ms)'
_ROW_HEIGHT_PX: Final = 180


def starts_of(runs: Sequence[ScoredRun]) -> list[ScoredRun]:
    """Return the runs that have one with their first periods in place of the scored window."""
    return [
        replace(run, time_s=run.start.time_s, reference_um=run.start.reference_um,
                displacement_um=run.start.displacement_um, voltage_v=run.start.voltage_v,
                max_error_um=float(np.abs(
                    run.start.reference_um - run.start.displacement_um).max()))
        for run in runs if run.start is not None]


def tracking_panels(runs: Sequence[ScoredRun]) -> list[Panel]:
    """Return desired and measured displacement, and the errors, over time."""
    return [
        Panel(_TIME, 'displacement (µm)', [
            Trace('desired', runs[0].window_ms, runs[0].reference_um, INK, 'dotted', width_px=2.5),
            *(_trace(run, runs, run.displacement_um) for run in runs)]),
        Panel(_TIME, 'error (µm)', [_trace(run, runs, run.error_um) for run in runs])]


def error_panels(runs: Sequence[ScoredRun]) -> list[Panel]:
    """Return the error of each run over time, in a panel of its own."""
    return [
        Panel(_TIME, 'error (µm)', [_trace(run, runs, run.error_um)],
              title=f'{run_label(run, runs)}: NRMSE {run.nrmse_percent:.2f} %, largest '
              f'{run.max_error_um:.3f} µm',
              y_range=(-limit, limit) if limit > 0.0 else None, height_px=_ROW_HEIGHT_PX)
        for run, limit in zip(runs, error_limits_um(runs), strict=True)]


def voltage_panels(runs: Sequence[ScoredRun]) -> list[Panel]:
    """Return the voltage of each run over time, with rails and limited samples."""
    panels = []
    for run in runs:
        limited = limited_voltage(run)
        marks = [
            Trace(label, run.window_ms, values, colour, 'none', 'filled')
            for values, colour, label in (
                (limited.slewing_v, SLEW_COLOUR, 'slewing'),
                (limited.at_rails_v, RAIL_COLOUR, 'at a rail'))
            if np.isfinite(values).any()]
        shown = [float(run.voltage_v.min()), float(run.voltage_v.max()), *limited.rails_v]
        margin = 0.08 * (max(shown) - min(shown)) or 1.0
        panels.append(Panel(
            _TIME, 'voltage (V)', [_trace(run, runs, run.voltage_v), *marks],
            title=voltage_title(run, runs), height_px=_ROW_HEIGHT_PX,
            lines=[Line(rail_v, 'rail') for rail_v in limited.rails_v],
            y_range=(min(shown) - margin, max(shown) + margin)))
    return panels


def spectrum_panels(runs: Sequence[ScoredRun]) -> list[Panel]:
    """Return the amplitude of the errors at the harmonics of the reference."""
    traces = []
    for number, run in enumerate(runs):
        found = run_error_harmonics(run)
        traces.append(Trace(
            run_label(run, runs), harmonic_places(found, number, len(runs)),
            NM_PER_UM * found.amplitude_um, scheme_colour(run.scheme), 'none',
            'open' if number % 2 else 'filled'))
    return [Panel('harmonic of the reference', 'amplitude of the error (nm)', traces, log_y=True)]


def hysteresis_panels(runs: Sequence[ScoredRun]) -> list[CurvePanel]:
    """Return displacement over voltage, one curve for each run."""
    return [CurvePanel('voltage (V)', 'displacement (µm)', [
        Curve(run_label(run, runs), run.voltage_v, run.displacement_um,
              scheme_colour(run.scheme), run_line_style(run, runs), along=run.window_ms)
        for run in runs], along_label=_TIME)]


def _trace(run: ScoredRun, runs: Sequence[ScoredRun], values: NDArray[np.float64]) -> Trace:
    return Trace(
        run_label(run, runs), run.window_ms, values, scheme_colour(run.scheme),
        run_line_style(run, runs))
