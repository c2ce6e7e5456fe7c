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

"""Frequency responses with their confidence, and uncertainty under its bounds."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator, StrMethodFormatter
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.layout import WIDTH_IN, legend_columns
from piezo_ros.report.rendering import FAINT, INK, SERIES, house_style

__all__ = [
    'BoundCurve',
    'ResponseCurve',
    'magnitude_and_phase',
    'response_figure',
    'uncertainty_figure',
]

# A response of a larger range than this is shown in decibels.
_LINEAR_RANGE: Final = 8.0
_MARKERS: Final = ('o', 's', '^', 'D', 'v', 'P')
_DASHES: Final = ('solid', 'dashed', 'dotted', 'dashdot')
# More markers than this become a picture: each would be an element of the page.
_MANY_POINTS: Final = 2500
_LEGEND_ROW_IN: Final = 0.2
_SUPERSCRIPTS: Final = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


class ResponseCurve(NamedTuple):
    """
    One frequency response of `response_figure`.

    Attributes
    ----------
    label : str
        What it is, for the legend.
    frequency_hz : array_like, shape (N,)
        Frequencies, ascending, hertz.
    response : array_like of complex, shape (N,)
        Output over input.
    confidence_radius : array_like, shape (N,), optional
        Radius of the circle that holds the true response; bars of points, bands of lines.
    style : str
        ``'points'`` for what was measured, ``'line'`` for a model.

    """

    label: str
    frequency_hz: ArrayLike
    response: ArrayLike
    confidence_radius: ArrayLike | None = None
    style: str = 'points'


class BoundCurve(NamedTuple):
    """
    One bound of `uncertainty_figure`.

    Attributes
    ----------
    label : str
        What it is, for the legend.
    frequency_hz, magnitude : array_like, shape (N,)
        |W| at each frequency.

    """

    label: str
    frequency_hz: ArrayLike
    magnitude: ArrayLike


class _Polar(NamedTuple):
    magnitude: NDArray[np.float64]
    phase_deg: NDArray[np.float64]
    magnitude_radius: NDArray[np.float64]
    phase_radius_deg: NDArray[np.float64]


def magnitude_and_phase(curve: ResponseCurve) -> _Polar:
    """
    Return a response as magnitude and phase with the half widths of their confidence.

    Parameters
    ----------
    curve : ResponseCurve
        The response.

    Returns
    -------
    magnitude, phase_deg, magnitude_radius, phase_radius_deg : ndarray, shape (N,)
        The phase is unwrapped along the frequency; the radii are 0 where none is known, and a
        circle that holds the origin leaves the phase open by 180 degrees.

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
    return _Polar(
        magnitude, np.degrees(np.unwrap(np.angle(response))), radius,
        np.where(radius < magnitude, half_angle, 180.0))


def response_figure(
    curves: Sequence[ResponseCurve], *, title: str, magnitude_label: str = 'magnitude',
    unit: str = '',
) -> Figure:
    """
    Draw frequency responses, magnitude over phase (Fig. 6, 7 and 9 in Liu 2015).

    Parameters
    ----------
    curves : sequence of ResponseCurve
        At least one. One line is drawn in ink; as many lines as sets of points pair with them in
        colour.
    title : str
        Heading.
    magnitude_label, unit : str, optional
        What the magnitude is called, and its unit; nothing for a ratio of displacements.

    Returns
    -------
    Figure
        Magnitude (linear, or in decibels where it spans more than a factor of eight) and phase
        in degrees over a logarithmic frequency.

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
    decibels = smallest <= 0.0 or largest / smallest > _LINEAR_RANGE
    count = sum(len(polar.magnitude) for curve, polar in zip(curves, polars, strict=True)
                if curve.style == 'points')
    columns = legend_columns([curve.label for curve in curves])
    rows = math.ceil(len(curves) / columns)
    more_in = _LEGEND_ROW_IN * (rows - 1)
    height_in = 4.75 + more_in
    with house_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        top, bottom = figure.subplots(
            2, 1, sharex=True,
            gridspec_kw={'height_ratios': (3, 2), 'hspace': 0.1, 'left': 0.1, 'right': 0.985,
                         'top': 1 - (0.56 + more_in) / height_in,
                         'bottom': 0.48 / height_in})
        for curve, polar, (colour, line, marker) in zip(
                curves, polars, _looks(curves), strict=True):
            low, high = (polar.magnitude + sign * polar.magnitude_radius for sign in (-1, 1))
            values = [polar.magnitude, low, high]
            if decibels:
                with np.errstate(divide='ignore', invalid='ignore'):
                    values = [20.0 * np.log10(np.maximum(value, 0.0)) for value in values]
            phase = [polar.phase_deg + sign * polar.phase_radius_deg for sign in (0, -1, 1)]
            for axes, (middle, below, above) in ((top, values), (bottom, phase)):
                if curve.style == 'line':
                    _draw_line(axes, curve, (middle, below, above), colour, line)
                else:
                    _draw_points(
                        axes, curve, (middle, below, above), colour, marker,
                        rasterized=count > _MANY_POINTS)
        suffix = f' (dB{f" re 1 {unit}" if unit else ""})' if decibels else (
            f' ({unit})' if unit else '')
        top.set_ylabel(f'{magnitude_label}{suffix}')
        bottom.set_ylabel('phase (°)')
        bottom.yaxis.set_major_locator(_degree_locator(polars))
        bottom.set_xlabel('frequency (Hz)')
        _logarithmic_frequency(bottom, [np.asarray(curve.frequency_hz) for curve in curves])
        if not decibels:
            top.set_ylim(bottom=0.0)
        top.set_title(title, loc='left', fontsize=10.5, fontweight='bold',
                      pad=8 + 14.5 * rows)
        top.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=columns, borderpad=0,
                   borderaxespad=0.35, handlelength=1.4, columnspacing=1.5)
        figure.align_ylabels()
    return figure


def uncertainty_figure(
    frequency_hz: ArrayLike, uncertainty: ArrayLike, bounds: Sequence[BoundCurve],
) -> Figure:
    """
    Draw the measured uncertainty and bounds of it (Fig. 8 in Liu 2015).

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Frequencies of all measured points, hertz.
    uncertainty : array_like of float or complex, shape (N,)
        Delta at these points, (7) in Liu 2015.
    bounds : sequence of BoundCurve
        |W|, each a line.

    Returns
    -------
    Figure
        |Delta| as faint points under the bounds, both axes logarithmic.

    Raises
    ------
    ValueError
        If the lengths differ, or there is no point.

    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    size = np.abs(np.asarray(uncertainty))
    if frequency.shape != size.shape or size.ndim != 1 or size.size == 0:
        raise ValueError(
            f'frequency_hz has shape {frequency.shape} and uncertainty {size.shape}, they must be '
            'equally long and not empty')
    measured = 'measured |Δ|'
    columns = legend_columns([measured, *(bound.label for bound in bounds)])
    more_in = _LEGEND_ROW_IN * (math.ceil((1 + len(bounds)) / columns) - 1)
    height_in = 3.7 + more_in
    with house_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        axes = figure.subplots(gridspec_kw={
            'left': 0.1, 'right': 0.985, 'top': 1 - (0.35 + more_in) / height_in,
            'bottom': 0.5 / height_in})
        axes.plot(frequency, size, linestyle='none', marker='o', markersize=3.4, color=FAINT,
                  markeredgewidth=0, alpha=0.55, rasterized=size.size > _MANY_POINTS,
                  label=measured)
        colours = (INK, *SERIES[2:], *SERIES[:2])
        for number, bound in enumerate(bounds):
            axes.plot(np.asarray(bound.frequency_hz), np.asarray(bound.magnitude),
                      color=colours[number % len(colours)],
                      linestyle=_DASHES[number % len(_DASHES)], linewidth=1.7, label=bound.label)
        axes.set_yscale('log', nonpositive='mask')
        axes.yaxis.set_major_formatter(lambda value, _: _power_of_ten(value))
        axes.set_ylim(_uncertainty_limits(size, bounds))
        axes.set_ylabel('magnitude')
        axes.set_xlabel('frequency (Hz)')
        _logarithmic_frequency(
            axes, [frequency, *(np.asarray(bound.frequency_hz) for bound in bounds)])
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=columns, borderpad=0,
                    borderaxespad=0.35, handlelength=1.8, columnspacing=1.8)
    return figure


def _looks(curves: Sequence[ResponseCurve]) -> list[tuple[str, str, str]]:
    """Return colour, line style and marker of each curve."""
    lines = [curve for curve in curves if curve.style == 'line']
    paired = len(lines) > 1 and 2 * len(lines) in (len(curves), 2 * len(curves))
    looks, counts = [], {'line': 0, 'points': 0}
    for curve in curves:
        number = counts[curve.style]
        counts[curve.style] += 1
        colour = INK if curve.style == 'line' and not paired else SERIES[number % len(SERIES)]
        looks.append((
            colour, 'solid' if paired else _DASHES[number % len(_DASHES)],
            _MARKERS[number % len(_MARKERS)]))
    return looks


_Three = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _draw_line(
    axes: Axes, curve: ResponseCurve, values: _Three, colour: str, line: str,
) -> None:
    frequency_hz = np.asarray(curve.frequency_hz, dtype=np.float64)
    middle, below, above = values
    if curve.confidence_radius is not None:
        axes.fill_between(frequency_hz, below, above, color=colour, alpha=0.2, linewidth=0)
    # Over the points: a line under dense points would not be seen.
    axes.plot(frequency_hz, middle, color=colour, linestyle=line, linewidth=1.4, zorder=3,
              label=curve.label)


def _draw_points(
    axes: Axes, curve: ResponseCurve, values: _Three, colour: str, marker: str, *,
    rasterized: bool,
) -> None:
    frequency_hz = np.asarray(curve.frequency_hz, dtype=np.float64)
    middle, below, above = values
    if curve.confidence_radius is not None:
        axes.vlines(frequency_hz, below, above, color=colour, linewidth=0.9, alpha=0.7,
                    rasterized=rasterized)
    axes.plot(frequency_hz, middle, linestyle='none', marker=marker, markersize=4.6, color=colour,
              markerfacecolor='none', markeredgewidth=1.1, rasterized=rasterized, label=curve.label)


def _logarithmic_frequency(axes: Axes, frequencies_hz: Sequence[NDArray[np.float64]]) -> None:
    axes.set_xscale('log')
    low = min(float(values.min()) for values in frequencies_hz)
    high = max(float(values.max()) for values in frequencies_hz)
    axes.set_xlim(low / 1.06, high * 1.06)
    if high / low < 30.0:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    axes.xaxis.set_minor_formatter(lambda *_: '')


def _degree_locator(polars: Sequence[_Polar]) -> MultipleLocator | MaxNLocator:
    span = max(float(np.ptp(polar.phase_deg)) for polar in polars)
    for step, widest in ((30.0, 120.0), (45.0, 240.0), (90.0, 500.0), (180.0, 1000.0)):
        if 45.0 < span <= widest:
            return MultipleLocator(step)
    return MaxNLocator(5)


def _power_of_ten(value: float) -> str:
    if value >= 1e-3:
        return f'{value:g}'
    return f'10{str(round(math.log10(value))).translate(_SUPERSCRIPTS)}'


def _uncertainty_limits(
    size: NDArray[np.float64], bounds: Sequence[BoundCurve],
) -> tuple[float, float]:
    """Return a range that shows nearly all points and every bound: a few points are almost 0."""
    seen = [float(np.percentile(size[size > 0.0], 1.0))] if np.any(size > 0.0) else [1e-3]
    seen += [float(np.min(np.asarray(bound.magnitude))) for bound in bounds]
    high = max([float(size.max()), *(float(np.max(np.asarray(bound.magnitude)))
                                     for bound in bounds)])
    return 0.7 * float(min(seen)), 1.4 * max(high, 1e-3)
