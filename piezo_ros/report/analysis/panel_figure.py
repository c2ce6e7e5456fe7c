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

"""Draws the panels of an interactive chart as a figure, for printing and as files."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from piezo_ros.report.figures.panels import WIDTH_IN, legend_grid
from piezo_ros.report.figures.style import FAINT, INK, MANY_POINTS, figure_style
from piezo_ros.report.page.chart import Line, Panel, Trace
from piezo_ros.report.page.content import Picture

__all__ = ['chart_picture', 'panel_figure']

_INCHES_PER_PIXEL: Final = 2.35 / 260.0
_LEGEND_ROW_IN: Final = 0.21
_TITLE_IN: Final = 0.24
_BELOW_IN: Final = 0.52
_PLAIN: Final = (1e-3, 1e5)  # numbers on a logarithmic axis between these are written out


def chart_picture(name: str, caption: str, panels: Sequence[Panel]) -> Picture:
    """
    Return a picture that is a chart on the screen and the same as a figure elsewhere.

    Parameters
    ----------
    name : str
        Stem of the files.
    caption : str
        Plain text below it.
    panels : sequence of Panel
        From top to bottom.

    """
    return Picture(name, caption, lambda: panel_figure(panels), panels)


def panel_figure(panels: Sequence[Panel]) -> Figure:
    """
    Draw the panels of a chart one below the other.

    Parameters
    ----------
    panels : sequence of Panel
        At least one.

    Returns
    -------
    Figure
        Panels of full width, each with its legend above it.

    """
    heads_in = [_head_in(panel) for panel in panels]
    bodies_in = [panel.height_px * _INCHES_PER_PIXEL for panel in panels]
    height_in = sum(heads_in) + sum(bodies_in) + _BELOW_IN * len(panels)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        top_in = height_in
        for panel, head_in, body_in in zip(panels, heads_in, bodies_in, strict=True):
            top_in -= head_in + body_in
            axes = figure.add_axes((
                0.095, top_in / height_in, 0.89, body_in / height_in))
            top_in -= _BELOW_IN
            _draw(axes, panel)
        figure.align_ylabels()
    return figure


def _head_in(panel: Panel) -> float:
    rows = legend_grid([trace.label for trace in panel.traces]).rows
    return _LEGEND_ROW_IN * rows + (_TITLE_IN if panel.title else 0.0) + 0.12


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.log_x:
        axes.set_xscale('log')
    if panel.log_y:
        axes.set_yscale('log', nonpositive='mask')
    for trace in panel.traces:
        _draw_trace(axes, trace)
    if panel.y_range is not None:
        axes.set_ylim(panel.y_range)
    axes.margins(x=0.01)
    low, high = axes.get_ylim()
    left, right = axes.get_xlim()
    for line in panel.lines:
        _draw_line(axes, line)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    for axis, is_log, limits in (
            (axes.xaxis, panel.log_x, (left, right)), (axes.yaxis, panel.log_y, (low, high))):
        if is_log and _PLAIN[0] <= limits[0] and limits[1] <= _PLAIN[1]:
            axis.set_major_formatter(StrMethodFormatter('{x:g}'))
            axis.set_minor_formatter(lambda *_: '')
    legend = legend_grid([trace.label for trace in panel.traces])
    if panel.title:
        axes.set_title(
            panel.title, loc='left', fontsize=10.5, fontweight='bold', pad=6 + 15 * legend.rows)
    axes.legend(
        loc='lower left', bbox_to_anchor=(0, 1), ncol=legend.columns, borderpad=0,
        borderaxespad=0.3, handlelength=2.2, columnspacing=1.6)


def _draw_trace(axes: Axes, trace: Trace) -> None:
    x, y = (np.asarray(values, dtype=np.float64) for values in (trace.x, trace.y))
    if trace.band is not None:
        low, high = (np.asarray(limit, dtype=np.float64) for limit in trace.band)
        axes.fill_between(x, low, high, color=trace.colour, alpha=0.25, linewidth=0)
    axes.plot(
        x, y, color=trace.colour, linestyle=trace.style,
        linewidth=0.85 * trace.width_px, marker='o' if trace.marker else '', markersize=3.4,
        markerfacecolor='none' if trace.marker == 'open' else trace.colour,
        rasterized=x.size > MANY_POINTS, label=trace.label)


def _draw_line(axes: Axes, line: Line) -> None:
    if line.axis == 'x':
        axes.axvline(line.value, color=FAINT, linewidth=0.9, linestyle='dashed')
        axes.annotate(
            line.label, (line.value, 1.0), xycoords=('data', 'axes fraction'),
            xytext=(3, -3), textcoords='offset points', va='top', fontsize=8.5, color=INK)
    else:
        axes.axhline(line.value, color=FAINT, linewidth=0.9, linestyle='dashed')
        axes.annotate(
            line.label, (1.0, line.value), xycoords=('axes fraction', 'data'),
            xytext=(-3, 2), textcoords='offset points', ha='right', fontsize=8.5, color=INK,
            annotation_clip=True)
