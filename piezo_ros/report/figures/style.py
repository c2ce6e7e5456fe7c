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
    'MANY_POINTS',
    'SCHEME_COLOURS',
    'SERIES',
    'figure_style',
    'scheme_colour',
]

INK: Final = '#1f2328'
GRID: Final = '#d8dee4'
BACKGROUND: Final = '#ffffff'
FAINT: Final = '#7f90a6'

# Okabe and Ito's colours, distinct with any colour vision. A scheme has one colour in all figures.
SCHEME_COLOURS: Final = {
    'fb': '#d55e00',
    'ff': '#0072b2',
    'fbff': '#009e73',
    'open_loop': '#aa4499',
}
_OTHER_SCHEME: Final = '#7a6a00'
# In order, for amplitudes and the like. Visible on a light page and on a dark one, because a
# rasterised point cannot change its colour.
SERIES: Final = ('#3567c0', '#8453bd', '#c04592', '#dc5f50', '#cf8520', '#968c10')
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
