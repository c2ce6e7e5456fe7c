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
Interactive charts of a page: what they show, and the library that draws them.

A chart is drawn in the browser by uPlot (static/uPlot.iife.min.js, MIT licence), which is part of
the page, so that a report stays one file. Values go to the page as 32-bit floats.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.page.curve_panel import CurvePanel, curve_panel_content
from piezo_ros.report.page.drawn_line import MARKERS, STYLES, DrawnLine, as_base64

__all__ = ['ChartLibrary', 'Line', 'Panel', 'Trace', 'chart_json', 'chart_library']

# More than a screen has columns of pixels, so that a zoom still shows detail.
_MOST_POINTS: Final = 6000
_PANEL_HEIGHT_PX: Final = 260


@dataclass(frozen=True)
class Trace(DrawnLine):
    """
    One curve of a panel.

    Attributes
    ----------
    x, y : array_like, shape (N,)
        Abscissa, ascending and finite, and ordinate. A y that is not finite is a gap.
    label, colour, style, marker, width_px
        As of `DrawnLine`.
    band : (array_like, array_like) or None
        Lower and upper limit of a shaded band around the curve, each of shape (N,).

    """

    band: tuple[ArrayLike, ArrayLike] | None = None


@dataclass(frozen=True)
class Line:
    """
    A straight line across a panel, such as a limit.

    Attributes
    ----------
    value : float
        Where it is.
    label : str
        Words beside it.
    axis : str
        ``'y'`` for a horizontal line at y = value, ``'x'`` for a vertical one.

    """

    value: float
    label: str
    axis: str = 'y'


@dataclass(frozen=True)
class Panel:
    """
    One pair of axes of a chart. Panels with the same x label share cursor and zoom.

    Attributes
    ----------
    x_label, y_label : str
        Labels of the axes, with units.
    traces : sequence of Trace
        At least one.
    title : str
        Above the panel; may be empty.
    lines : sequence of Line
        Limits and marks; visible where the range of the axes includes them.
    log_x, log_y : bool
        Whether an axis is logarithmic; values on it must be positive.
    y_range : (float, float) or None
        Fixed range of y; None follows the visible values.
    height_px : int
        Height, pixels.

    """

    x_label: str
    y_label: str
    traces: Sequence[Trace]
    title: str = ''
    lines: Sequence[Line] = ()
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None
    height_px: int = _PANEL_HEIGHT_PX


class ChartLibrary(NamedTuple):
    """
    What a page with charts contains once.

    Attributes
    ----------
    style : Markup
        A ``<style>`` element for the head.
    script : Markup
        ``<script>`` elements for the end of the body: uPlot with its licence, and ``piezoCharts``,
        which ``piezoCharts.start()`` has still to start.

    """

    style: Markup
    script: Markup


@cache
def chart_library() -> ChartLibrary:
    """Return the vendored uPlot and the script that draws charts with it."""
    licence = _static('uPlot.LICENSE').replace('*/', '* /')
    return ChartLibrary(
        Markup(f'<style>\n{_static("uPlot.min.css")}</style>\n'),
        Markup(f'<script>\n/*\n{licence}*/\n{_static("uPlot.iife.min.js")}</script>\n'
               f'<script>\n{_static("chart.js")}{_static("curves.js")}</script>\n'))


def chart_json(
    name: str, description: str, panels: Sequence[Panel | CurvePanel],
) -> Markup:
    """
    Return the data of a chart for the script of its page.

    Parameters
    ----------
    name : str
        Name of the picture; unique on the page.
    description : str
        What the chart shows, for screen readers.
    panels : sequence of Panel or CurvePanel
        From top to bottom.

    Returns
    -------
    Markup
        JSON that is safe inside a ``<script>`` element. A trace of more than 6 000 points is
        thinned: of each interval its least and its greatest value stay.

    Raises
    ------
    ValueError
        If a trace cannot be drawn; the message names it.

    """
    content = {
        'name': name, 'description': description,
        'panels': [
            curve_panel_content(panel) if isinstance(panel, CurvePanel) else _panel(panel)
            for panel in panels]}
    text = json.dumps(content, ensure_ascii=False, allow_nan=False)
    return Markup(text.replace('<', r'\u003c').replace('>', r'\u003e').replace('&', r'\u0026'))


def _panel(panel: Panel) -> dict[str, Any]:
    abscissas: dict[str, int] = {}
    traces = [_trace(trace, panel, abscissas) for trace in panel.traces]
    return {
        'title': panel.title, 'x_label': panel.x_label, 'y_label': panel.y_label,
        'log_x': panel.log_x, 'log_y': panel.log_y,
        'y_range': None if panel.y_range is None else [float(end) for end in panel.y_range],
        'height': panel.height_px, 'abscissas': list(abscissas), 'traces': traces,
        'lines': [{'axis': line.axis, 'value': float(line.value), 'label': line.label}
                  for line in panel.lines]}


def _trace(trace: Trace, panel: Panel, abscissas: dict[str, int]) -> dict[str, Any]:
    if trace.style not in STYLES:
        raise ValueError(
            f'style of trace {trace.label!r} is {trace.style!r}, it must be one of '
            f'{", ".join(STYLES)}')
    if trace.marker not in MARKERS:
        raise ValueError(
            f'marker of trace {trace.label!r} is {trace.marker!r}, it must be one of '
            f'{", ".join(map(repr, MARKERS))}')
    x, y = _values(trace.x), _values(trace.y)
    band = [] if trace.band is None else [_values(limit) for limit in trace.band]
    if x.ndim != 1 or any(values.shape != x.shape for values in (y, *band)):
        shapes = ', '.join(str(values.shape) for values in (x, y, *band))
        raise ValueError(
            f'x, y and band of trace {trace.label!r} have the shapes {shapes}, they must be one '
            'shape (N,)')
    if not np.isfinite(x).all() or (np.diff(x) < 0.0).any():
        raise ValueError(f'x of trace {trace.label!r} must be finite and ascending')
    if panel.log_x and x.size and x[0] <= 0.0:
        raise ValueError(
            f'x of trace {trace.label!r} begins with {x[0]}, on a logarithmic axis it must be '
            'above zero')
    if panel.log_y:
        y, *band = (np.where(values > 0.0, values, np.nan) for values in (y, *band))
    shown = _shown_points(y)
    x_text = as_base64(x[shown])
    return {
        **trace.look, 'x': abscissas.setdefault(x_text, len(abscissas)), 'y': as_base64(y[shown]),
        'band': [as_base64(limit[shown]) for limit in band] or None}


def _values(values: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)


def _shown_points(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the points that stay: the least and greatest of each interval."""
    if values.size <= _MOST_POINTS:
        return np.arange(values.size)
    interval = math.ceil(2 * values.size / _MOST_POINTS)
    whole = values.size // interval * interval
    starts = np.arange(0, whole, interval)
    rows = values[:whole].reshape(-1, interval)
    least = starts + np.where(np.isfinite(rows), rows, np.inf).argmin(axis=1)
    greatest = starts + np.where(np.isfinite(rows), rows, -np.inf).argmax(axis=1)
    gaps = starts[~np.isfinite(rows).all(axis=1)] + np.argmax(
        ~np.isfinite(rows[~np.isfinite(rows).all(axis=1)]), axis=1)
    return np.unique(np.concatenate(
        ([0], least, greatest, gaps, np.arange(whole, values.size), [values.size - 1])))


def _static(name: str) -> str:
    return files(__package__).joinpath('static', name).read_text(encoding='utf-8')
