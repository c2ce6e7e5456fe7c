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

"""Arranges panels on common axes, the legend above them, and logarithmic axes."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

__all__ = [
    'LEGEND_ROW_IN',
    'WIDTH_IN',
    'LegendGrid',
    'PanelGrid',
    'add_head',
    'legend_grid',
    'logarithmic_frequency_axis',
    'panel_grid',
    'percent_axis',
]

WIDTH_IN: Final = 7.6
LEGEND_ROW_IN: Final = 0.2
_LEFT_IN: Final = 0.5
_SINGLE_WIDTH_IN: Final = 4.6
_PANEL_HEIGHT_IN: Final = 2.05
_TITLE_IN: Final = 0.22
_PANEL_COLUMNS: Final = 3
# An average letter of the legend, a handle with the space around it, and the width of a row.
_LETTER_IN: Final = 0.073
_HANDLE_IN: Final = 0.46
_LEGEND_IN: Final = 6.75


class PanelGrid(NamedTuple):
    """
    Panels of equal size.

    Attributes
    ----------
    figure : Figure
        The figure that contains them.
    panels : list of Axes
        On common axes, row by row; the lowest of each column shows the numbers of x.
    spare : Axes or None
        One more panel at the end with axes of its own, the ordinate on the right.

    """

    figure: Figure
    panels: list[Axes]
    spare: Axes | None


class LegendGrid(NamedTuple):
    """Arrangement of the entries of a legend in columns and rows."""

    columns: int
    rows: int


def panel_grid(
    count: int, *, x_label: str, y_label: str, spare: bool = False, title: str = '',
) -> PanelGrid:
    """
    Return panels on common axes, with room for one line of legend above them.

    Parameters
    ----------
    count : int
        Panels on common axes.
    x_label, y_label : str
        Labels of the outer panels.
    spare : bool, optional
        Whether to add a panel with axes of its own.
    title : str, optional
        Heading for `add_head`, which needs room.

    Returns
    -------
    PanelGrid
        The empty panels, at most three in a row.

    """
    total = count + spare
    columns = min(total, _PANEL_COLUMNS)
    rows = math.ceil(total / columns)
    width_in = WIDTH_IN if columns > 1 else _SINGLE_WIDTH_IN
    top_in = 0.5 + (_TITLE_IN if title else 0.0)
    height_in = top_in + 0.35 + _PANEL_HEIGHT_IN * rows
    figure = Figure(figsize=(width_in, height_in))
    places = figure.add_gridspec(
        rows, columns, left=_LEFT_IN / width_in, right=1 - (0.5 if spare else 0.12) / width_in,
        wspace=0.1, hspace=0.36 if spare else 0.26, top=1 - top_in / height_in,
        bottom=0.48 / height_in)
    panels: list[Axes] = []
    for number in range(count):
        row, column = divmod(number, columns)
        first = panels[0] if panels else None
        panel = figure.add_subplot(places[row, column], sharex=first, sharey=first)
        panel.tick_params(labelbottom=number + columns >= count, labelleft=column == 0)
        if number + columns >= total:
            panel.set_xlabel(x_label)
        if column == 0:
            panel.set_ylabel(y_label)
        panels.append(panel)
    extra = None
    if spare:
        extra = figure.add_subplot(places[rows - 1, (total - 1) % columns])
        extra.spines['left'].set_visible(False)
        extra.spines['right'].set_visible(True)
        extra.yaxis.tick_right()
        extra.yaxis.set_label_position('right')
    return PanelGrid(figure, panels, extra)


def add_head(figure: Figure, handles: list[Artist], title: str = '') -> None:
    """Put a heading and a legend of one line above the panels."""
    width_in, height_in = figure.get_size_inches()
    left = _LEFT_IN / width_in
    if title:
        figure.text(left, 1 - 0.06 / height_in, title, va='top', fontsize=10.5, fontweight='bold')
    figure.legend(
        handles=handles, loc='upper left', ncol=len(handles), borderpad=0, borderaxespad=0.5,
        bbox_to_anchor=(left, 1 - (_TITLE_IN / height_in if title else 0.0)),
        handlelength=1.6, columnspacing=1.8)


def legend_grid(labels: Sequence[str]) -> LegendGrid:
    """Return how many columns and rows a legend above a figure of full width needs."""
    entry_in = _LETTER_IN * max(len(label) for label in labels) + _HANDLE_IN
    columns = max(1, min(len(labels), int(_LEGEND_IN / entry_in)))
    return LegendGrid(columns, math.ceil(len(labels) / columns))


def percent_axis(panel: Axes, which: str = 'y') -> None:
    """Make an axis of errors logarithmic with plain numbers, as errors may differ tenfold."""
    panel.set(**{f'{which}scale': 'log'})
    axis = panel.yaxis if which == 'y' else panel.xaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter('{x:g}'))
    axis.set_minor_locator(NullLocator())


def logarithmic_frequency_axis(
    axes: Axes, frequencies_hz: Sequence[NDArray[np.float64]],
) -> None:
    """
    Make x a logarithmic frequency axis with plain numbers.

    Parameters
    ----------
    axes : Axes
        The panel.
    frequencies_hz : sequence of ndarray
        Frequencies of each curve, hertz; all of them become visible.

    """
    axes.set_xscale('log')
    low = min(float(values.min()) for values in frequencies_hz)
    high = max(float(values.max()) for values in frequencies_hz)
    axes.set_xlim(low / 1.06, high * 1.06)
    if high / low < 30.0:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    axes.xaxis.set_minor_formatter(lambda *_: '')
