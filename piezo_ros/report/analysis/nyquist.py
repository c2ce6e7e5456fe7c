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
Draws the Nyquist curve of a loop L with what it must stay clear of.

    |S| = 1/|1 + L| < M   outside the circle of radius 1/M about -1
    |W T| < 1             no disc of radius |W L| about L contains -1, (10) in Liu 2015
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from piezo_ros.report.figures.style import FAINT, INK, LINE_STYLES, SERIES, figure_style
from piezo_ros.report.page.curve_panel import Curve, CurvePanel

__all__ = ['NyquistCurve', 'nyquist_figure', 'nyquist_panel']

_LIMITS: Final = ((-2.6, 1.4), (-2.0, 2.0))
_DISCS: Final = 18
_CIRCLE_POINTS: Final = 181
_PANEL_HEIGHT_PX: Final = 520

_Floats = NDArray[np.float64]


class NyquistCurve(NamedTuple):
    """
    One loop of `nyquist_figure`.

    Attributes
    ----------
    label : str
        Its name in the legend.
    frequency_hz : ndarray, shape (N,)
        Ascending frequencies, hertz.
    response : ndarray of complex, shape (N,)
        L there.

    """

    label: str
    frequency_hz: _Floats
    response: NDArray[np.complex128]


def nyquist_figure(
    curves: Sequence[NyquistCurve], *, max_sensitivity: float,
    bound: Callable[[_Floats], _Floats] | None = None,
    points: NDArray[np.complex128] | None = None,
) -> Figure:
    """
    Draw the Nyquist curves of some loops about -1.

    Parameters
    ----------
    curves : sequence of NyquistCurve
        The loops; the discs belong to the first one.
    max_sensitivity : float
        Limit M on |S|, above 1.
    bound : callable, optional
        |W| as a function of frequencies in hertz.
    points : ndarray of complex, optional
        L at the measured points.

    Returns
    -------
    Figure
        Re L and Im L on equal scales.

    """
    with figure_style():
        figure = Figure(figsize=(6.4, 6.1))
        axes = figure.add_axes((0.1, 0.085, 0.875, 0.79))
        axes.set_aspect('equal')
        axes.add_patch(Circle(
            (-1.0, 0.0), 1.0 / max_sensitivity, facecolor=SERIES[3], alpha=0.25, edgecolor='none'))
        axes.add_patch(Circle(
            (-1.0, 0.0), 1.0 / max_sensitivity, fill=False, edgecolor=SERIES[3], linewidth=1.3,
            label=f'|S| = {max_sensitivity:.3g}'))
        axes.add_patch(Circle(
            (0.0, 0.0), 1.0, fill=False, edgecolor=FAINT, linestyle='dotted', label='|L| = 1'))
        if bound is not None:
            _draw_discs(axes, curves[0], bound)
        for number, curve in enumerate(curves):
            axes.plot(
                curve.response.real, curve.response.imag, color=(INK, *SERIES)[number],
                linestyle=LINE_STYLES[number % len(LINE_STYLES)], linewidth=1.7, zorder=3,
                label=curve.label)
        if points is not None and points.size:
            axes.plot(
                points.real, points.imag, linestyle='none', marker='o', markersize=4.2,
                color=SERIES[1], markerfacecolor='none', label='measured points')
        axes.plot(-1.0, 0.0, linestyle='none', marker='+', markersize=11, markeredgewidth=2.0,
                  color=INK, zorder=4)
        axes.annotate('−1', (-1.0, 0.0), xytext=(5, 6), textcoords='offset points', color=INK)
        axes.set_xlim(*_LIMITS[0])
        axes.set_ylim(*_LIMITS[1])
        axes.set_xlabel('Re L')
        axes.set_ylabel('Im L')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=3, borderpad=0,
                    borderaxespad=0.4)
    return figure


def nyquist_panel(
    curves: Sequence[NyquistCurve], *, max_sensitivity: float,
    bound: Callable[[_Floats], _Floats] | None = None,
    points: tuple[_Floats, NDArray[np.complex128]] | None = None,
) -> CurvePanel:
    """
    Return the same as a panel of an interactive chart.

    Parameters
    ----------
    curves, max_sensitivity, bound
        As of `nyquist_figure`.
    points : (ndarray, ndarray of complex), optional
        Frequencies in hertz and L at the measured points.

    """
    shown = [
        Curve(curve.label, curve.response.real, curve.response.imag,
              (INK, *SERIES)[number], LINE_STYLES[number % len(LINE_STYLES)], width_px=2.0,
              along=curve.frequency_hz)
        for number, curve in enumerate(curves)]
    if points is not None and points[1].size:
        shown.append(Curve(
            'measured points', points[1].real, points[1].imag, SERIES[1], 'none', 'open',
            along=points[0]))
    shown.append(_circle(
        f'|S| = {max_sensitivity:.3g}', [(-1.0, 1.0 / max_sensitivity)], SERIES[3], 'solid'))
    if bound is not None:
        shown.append(_circle('discs of |W L|', _discs(curves[0], bound), SERIES[4], 'dashed'))
    shown.append(_circle('|L| = 1', [(0.0, 1.0)], FAINT, 'dotted'))
    shown.append(Curve('−1', [-1.0], [0.0], INK, 'none', 'filled'))
    return CurvePanel(
        'Re L', 'Im L', shown, along_label='frequency (Hz)', x_range=_LIMITS[0],
        y_range=_LIMITS[1], has_equal_scales=True, height_px=_PANEL_HEIGHT_PX)


def _circle(
    label: str, discs: Sequence[tuple[complex, float]], colour: str, style: str,
) -> Curve:
    """Return circles, each a centre and a radius, as one curve with gaps between them."""
    around = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, _CIRCLE_POINTS))
    places = np.concatenate([
        np.append(centre + radius * around, np.nan) for centre, radius in discs])
    return Curve(label, places.real, places.imag, colour, style, width_px=1.2)


def _draw_discs(
    axes: Axes, curve: NyquistCurve, bound: Callable[[_Floats], _Floats],
) -> None:
    for number, (centre, radius) in enumerate(_discs(curve, bound)):
        axes.add_patch(Circle(
            (centre.real, centre.imag), radius, fill=False, edgecolor=SERIES[4], linewidth=0.9,
            linestyle='dashed', label='discs of |W L|' if not number else None))


def _discs(
    curve: NyquistCurve, bound: Callable[[_Floats], _Floats],
) -> list[tuple[complex, float]]:
    """Return centre L and radius |W L| of some discs, of those near -1 the widest ones."""
    low, high = curve.frequency_hz[0], curve.frequency_hz[-1]
    seen = np.abs(curve.response) < max(map(abs, _LIMITS[0]))
    if np.any(seen):
        low, high = curve.frequency_hz[seen][0], curve.frequency_hz[seen][-1]
    frequency_hz = np.geomspace(low, high, _DISCS)
    middle = (np.interp(frequency_hz, curve.frequency_hz, curve.response.real)
              + 1j * np.interp(frequency_hz, curve.frequency_hz, curve.response.imag))
    radii = np.asarray(bound(frequency_hz)) * np.abs(middle)
    return [(complex(centre), float(radius))
            for centre, radius in zip(middle, radii, strict=True)]
