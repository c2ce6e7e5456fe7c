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

"""Style of all figures: fonts, lines, and one colour for each control scheme."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl

__all__ = [
    'BACKGROUND',
    'FAINT',
    'GRID',
    'INK',
    'LINE_STYLES',
    'MARKERS',
    'MANY_POINTS',
    'SCHEME_COLOURS',
    'SCHEME_MARKERS',
    'SERIES',
    'figure_style',
    'scheme_colour',
    'scheme_line_style',
]

INK: Final = '#1f2328'
GRID: Final = '#d8dee4'
BACKGROUND: Final = '#ffffff'
FAINT: Final = '#66768c'

# The hues of Okabe and Ito, distinct with any colour vision, dark enough for a contrast of 4.5 on
# white. A scheme has one colour and one line style in all figures.
SCHEME_COLOURS: Final = {
    'fb': '#b54a00',
    'ff': '#006ba6',
    'fbff': '#007a58',
    'open_loop': '#993b88',
}
_SCHEME_LINE_STYLES: Final = {
    'ff': 'solid', 'fbff': 'dashed', 'fb': 'dashdot', 'open_loop': 'dotted'}
SCHEME_MARKERS: Final = {'ff': 'o', 'fbff': 's', 'fb': '^', 'open_loop': 'D'}
_OTHER_SCHEME: Final = '#7a6a00'
# In order, for amplitudes and the like; contrast as above.
SERIES: Final = ('#3567c0', '#8453bd', '#b53a86', '#c4402f', '#9a6200', '#6f6800')
# One for each colour of SERIES, so that a curve is known without its colour.
MARKERS: Final = ('o', 's', '^', 'D', 'v', 'P')
LINE_STYLES: Final = ('solid', 'dashed', 'dotted', 'dashdot')
# More points than this are rasterised: each would be an element of the page.
MANY_POINTS: Final = 2500

_STYLE: Final[Any] = {  # Any: the type of its keys differs between versions of Matplotlib
    'font.family': 'sans-serif',
    'font.size': 9.5,
    'text.color': INK,
    'figure.facecolor': BACKGROUND,
    'axes.facecolor': 'none',
    'axes.edgecolor': INK,
    'axes.labelcolor': INK,
    'axes.linewidth': 0.8,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.unicode_minus': True,
    'grid.color': GRID,
    'grid.linewidth': 0.7,
    'xtick.color': INK,
    'ytick.color': INK,
    'xtick.major.size': 3.0,
    'ytick.major.size': 3.0,
    'lines.linewidth': 1.3,
    'legend.frameon': False,
    'svg.fonttype': 'none',
}


@contextmanager
def figure_style(salt: str = 'piezo_ros') -> Iterator[None]:
    """
    Draw and save in the style of the report, independent of the user's matplotlibrc.

    Parameters
    ----------
    salt : str, optional
        Seed of the identifiers inside an SVG.

    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        mpl.rcParams['svg.hashsalt'] = salt
        yield


def scheme_colour(scheme: str) -> str:
    """Return the colour of a control scheme, '#rrggbb'."""
    return SCHEME_COLOURS.get(scheme, _OTHER_SCHEME)


def scheme_line_style(scheme: str, earlier: int = 0) -> str:
    """
    Return the line style of a run.

    Parameters
    ----------
    scheme : str
        Its control scheme.
    earlier : int, optional
        Runs before it with the same scheme, and so the same colour, in the same figure.

    Returns
    -------
    str
        One of `LINE_STYLES`.

    """
    first = LINE_STYLES.index(_SCHEME_LINE_STYLES.get(scheme, 'solid'))
    return LINE_STYLES[(first + earlier) % len(LINE_STYLES)]
