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

"""
Draws frequency responses as magnitude and phase with their confidence.

Where the true value lies in a circle of radius r around the response g, the magnitude is |g| ± r
and the phase arg g ± arcsin(r / |g|).
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.figures.panels import (
    LEGEND_ROW_IN,
    WIDTH_IN,
    legend_grid,
    logarithmic_frequency_axis,
)
from piezo_ros.report.figures.style import (
    INK,
    LINE_STYLES,
    MANY_POINTS,
    MARKERS,
    SERIES,
    figure_style,
)

__all__ = ['MagnitudeAndPhase', 'ResponseCurve', 'magnitude_and_phase', 'response_figure']

# A response of a larger range than this is shown in decibels.
_LINEAR_RANGE: Final = 8.0


class ResponseCurve(NamedTuple):
    """
    One frequency response of `response_figure`.

    Attributes
    ----------
    label : str
        Its name in the legend.
    frequency_hz : array_like, shape (N,)
        Frequencies, ascending, hertz.
    response : array_like of complex, shape (N,)
        Output over input.
    confidence_radius : array_like, shape (N,), optional
        Radius of the circle that contains the true response; drawn as bars at points and as a band
        around a line.
    style : str
        ``'points'`` for a measurement, ``'line'`` for a model.

    """

    label: str
    frequency_hz: ArrayLike
    response: ArrayLike
    confidence_radius: ArrayLike | None = None
    style: str = 'points'


class MagnitudeAndPhase(NamedTuple):
    """
    A frequency response in polar form.

    Attributes
    ----------
    magnitude, phase_deg : ndarray, shape (N,)
        Magnitude, and phase in degrees, unwrapped along the frequency.
    magnitude_radius, phase_radius_deg : ndarray, shape (N,)
        Half widths of their confidence intervals; 0 where no confidence is known. A circle that
        contains the origin leaves the phase unknown: 180 degrees.

    """

    magnitude: NDArray[np.float64]
    phase_deg: NDArray[np.float64]
    magnitude_radius: NDArray[np.float64]
    phase_radius_deg: NDArray[np.float64]


class _Band(NamedTuple):
    middle: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


class _Look(NamedTuple):
    colour: str
    line_style: str
    marker: str


def magnitude_and_phase(curve: ResponseCurve) -> MagnitudeAndPhase:
    """
    Return a response in polar form with its confidence.

    Parameters
    ----------
    curve : ResponseCurve
        The response.

    Returns
    -------
    MagnitudeAndPhase
        With the half widths of the confidence intervals.

    Raises
    ------
    ValueError
        If the lengths differ, or there is no point.

    """
    response = np.asarray(curve.response, dtype=np.complex128)
    frequency_hz = np.asarray(curve.frequency_hz, dtype=np.float64)
    if frequency_hz.shape != response.shape or response.ndim != 1 or response.size == 0:
        raise ValueError(
            f'{curve.label}: frequency_hz has shape {frequency_hz.shape} and response '
            f'{response.shape}, they must be equally long and not empty')
    magnitude = np.abs(response)
    radius = (np.zeros_like(magnitude) if curve.confidence_radius is None
              else np.asarray(curve.confidence_radius, dtype=np.float64))
    if radius.shape != response.shape:
        raise ValueError(
            f'{curve.label}: confidence_radius has shape {radius.shape}, it must be that of '
            f'response, {response.shape}')
    with np.errstate(divide='ignore', invalid='ignore'):
        half_angle = np.degrees(np.arcsin(radius / magnitude))
    return MagnitudeAndPhase(
        magnitude, np.degrees(np.unwrap(np.angle(response))), radius,
        np.where(radius < magnitude, half_angle, 180.0))


def response_figure(
    curves: Sequence[ResponseCurve], *, title: str, unit: str = '',
    decibels: bool | None = None,
) -> Figure:
    """
    Draw frequency responses, magnitude over phase (Fig. 6, 7 and 9 in Liu 2015).

    Parameters
    ----------
    curves : sequence of ResponseCurve
        At least one. A single line is drawn in ink; as many lines as sets of points pair with them
        in colour.
    title : str
        Heading.
    unit : str, optional
        Unit of the magnitude; empty for a ratio of displacements.
    decibels : bool, optional
        Whether the magnitude is in decibels; by default where it spans more than a factor of
        eight.

    Returns
    -------
    Figure
        Magnitude and phase in degrees over a logarithmic frequency.

    Raises
    ------
    ValueError
        If there is no curve, a curve has an unknown style, or its lengths differ.

    """
    if not curves:
        raise ValueError('curves is empty, a figure needs at least one curve')
    for curve in curves:
        if curve.style not in ('points', 'line'):
            raise ValueError(
                f'style of {curve.label} is {curve.style!r}, allowed are points, line')
    polars = [magnitude_and_phase(curve) for curve in curves]
    largest = max(float(polar.magnitude.max()) for polar in polars)
    smallest = min(float(polar.magnitude.min()) for polar in polars)
    if decibels is None:
        decibels = smallest <= 0.0 or largest / smallest > _LINEAR_RANGE
    points = sum(curve.style == 'points' and polar.magnitude.size
                 for curve, polar in zip(curves, polars, strict=True))
    legend = legend_grid([curve.label for curve in curves])
    more_in = LEGEND_ROW_IN * (legend.rows - 1)
    height_in = 4.75 + more_in
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        top, bottom = figure.subplots(
            2, 1, sharex=True,
            gridspec_kw={'height_ratios': (3, 2), 'hspace': 0.1, 'left': 0.1, 'right': 0.985,
                         'top': 1 - (0.56 + more_in) / height_in,
                         'bottom': 0.48 / height_in})
        for curve, polar, look in zip(curves, polars, _looks(curves), strict=True):
            rasterized = points > MANY_POINTS
            _draw(top, curve, _magnitude_band(polar, decibels=decibels), look, rasterized)
            _draw(bottom, curve, _phase_band(polar), look, rasterized)
        if decibels:
            top.set_ylabel(f'magnitude (dB re 1 {unit})' if unit else 'magnitude (dB)')
        else:
            top.set_ylabel(f'magnitude ({unit})' if unit else 'magnitude')
            top.set_ylim(bottom=0.0)
        bottom.set_ylabel('phase (°)')
        bottom.yaxis.set_major_locator(_degree_locator(polars))
        bottom.set_xlabel('frequency (Hz)')
        logarithmic_frequency_axis(bottom, [np.asarray(curve.frequency_hz) for curve in curves])
        top.set_title(title, loc='left', fontsize=10.5, fontweight='bold',
                      pad=8 + 14.5 * legend.rows)
        top.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=legend.columns, borderpad=0,
                   borderaxespad=0.35, handlelength=1.4, columnspacing=1.5)
        figure.align_ylabels()
    return figure


def _looks(curves: Sequence[ResponseCurve]) -> list[_Look]:
    lines = [curve for curve in curves if curve.style == 'line']
    paired = len(lines) > 1 and 2 * len(lines) in (len(curves), 2 * len(curves))
    looks, counts = [], {'line': 0, 'points': 0}
    for curve in curves:
        number = counts[curve.style]
        counts[curve.style] += 1
        colour = INK if curve.style == 'line' and not paired else SERIES[number % len(SERIES)]
        looks.append(_Look(
            colour, 'solid' if paired else LINE_STYLES[number % len(LINE_STYLES)],
            MARKERS[number % len(MARKERS)]))
    return looks


def _magnitude_band(polar: MagnitudeAndPhase, *, decibels: bool) -> _Band:
    band = _Band(
        polar.magnitude, polar.magnitude - polar.magnitude_radius,
        polar.magnitude + polar.magnitude_radius)
    if not decibels:
        return band
    with np.errstate(divide='ignore', invalid='ignore'):
        return _Band(*(20.0 * np.log10(np.maximum(values, 0.0)) for values in band))


def _phase_band(polar: MagnitudeAndPhase) -> _Band:
    return _Band(
        polar.phase_deg, polar.phase_deg - polar.phase_radius_deg,
        polar.phase_deg + polar.phase_radius_deg)


def _draw(
    axes: Axes, curve: ResponseCurve, band: _Band, look: _Look, rasterized: bool,
) -> None:
    frequency_hz = np.asarray(curve.frequency_hz, dtype=np.float64)
    has_confidence = curve.confidence_radius is not None
    if curve.style == 'line':
        if has_confidence:
            axes.fill_between(
                frequency_hz, band.lower, band.upper, color=look.colour, alpha=0.2, linewidth=0)
        # Above the points: dense points would hide a line below them.
        axes.plot(
            frequency_hz, band.middle, color=look.colour, linestyle=look.line_style, linewidth=1.4,
            zorder=3, label=curve.label)
        return
    if has_confidence:
        axes.vlines(
            frequency_hz, band.lower, band.upper, color=look.colour, linewidth=0.9, alpha=0.7,
            rasterized=rasterized)
    axes.plot(
        frequency_hz, band.middle, linestyle='none', marker=look.marker, markersize=4.6,
        color=look.colour, markerfacecolor='none', markeredgewidth=1.1, rasterized=rasterized,
        label=curve.label)


def _degree_locator(polars: Sequence[MagnitudeAndPhase]) -> MultipleLocator | MaxNLocator:
    span = max(float(np.ptp(polar.phase_deg)) for polar in polars)
    for step, widest in ((30.0, 120.0), (45.0, 240.0), (90.0, 500.0), (180.0, 1000.0)):
        if 45.0 < span <= widest:
            return MultipleLocator(step)
    return MaxNLocator(5)
