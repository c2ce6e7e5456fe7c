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

"""From a matplotlib figure to bytes: the house style, deterministic SVG and PNG, page colours."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

__all__ = [
    'FAINT',
    'GRID',
    'INK',
    'PAPER',
    'SERIES',
    'house_style',
    'inline_svg',
    'png',
    'scheme_colour',
    'svg',
]

INK: Final = '#1f2328'
GRID: Final = '#d8dee4'
PAPER: Final = '#ffffff'

# Okabe and Ito's colours, told apart with any colour vision; one scheme has one colour everywhere.
_SCHEME_COLOURS: Final = {
    'fb': '#d55e00',
    'ff': '#0072b2',
    'fbff': '#009e73',
    'open_loop': '#aa4499',
}
_OTHER_SCHEME: Final = '#7a6a00'
# In order, for amplitudes and the like; dark and light enough to be seen on either page, for what
# is rasterised cannot change its colour.
SERIES: Final = ('#3567c0', '#8453bd', '#c04592', '#dc5f50', '#cf8520', '#968c10')
FAINT: Final = '#7f90a6'

_STYLE: Final[Any] = {  # Any: the type of its keys differs between versions of matplotlib
    'font.family': 'sans-serif',
    'font.size': 9.5,
    'text.color': INK,
    'figure.facecolor': PAPER,
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
_PNG_DOTS_PER_INCH: Final = 160
# Letters of 9.5 pt in a figure come out as large as small print on the page.
_PAGE_REM_PER_POINT: Final = 0.102
_PAGE_COLOURS: Final = {INK: 'currentColor', GRID: 'var(--grid)', PAPER: 'none'} | {
    colour: f'var(--{scheme.replace("_", "-")}, {colour})'
    for scheme, colour in _SCHEME_COLOURS.items()} | {
    colour: f'var(--series-{number}, {colour})' for number, colour in enumerate(SERIES, start=1)}


@contextmanager
def house_style(salt: str = 'piezo_ros') -> Iterator[None]:
    """
    Draw or save in the style of the report, whatever the user's matplotlibrc says.

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
    return _SCHEME_COLOURS.get(scheme, _OTHER_SCHEME)


def svg(figure: Figure, name: str) -> str:
    """
    Return a figure as SVG, the same text for the same figure.

    Parameters
    ----------
    figure : Figure
        What to draw.
    name : str
        Salt of the identifiers, so that two pictures of one page share none.

    Returns
    -------
    str
        A stand-alone document without date.

    """
    buffer = io.BytesIO()
    with house_style(salt=name):
        figure.savefig(
            buffer, format='svg', dpi=_PNG_DOTS_PER_INCH,  # of what is rasterised
            metadata={'Date': None, 'Creator': None})
    return buffer.getvalue().decode()


def png(figure: Figure) -> bytes:
    """Return a figure as PNG, the same bytes for the same figure."""
    buffer = io.BytesIO()
    with house_style():
        figure.savefig(
            buffer, format='png', dpi=_PNG_DOTS_PER_INCH, metadata={'Software': None})
    return buffer.getvalue()


def inline_svg(document: str, description: str) -> str:
    """
    Turn a stand-alone SVG of `svg` into an element that takes its colours from the page.

    Parameters
    ----------
    document : str
        What `svg` returned.
    description : str
        What the picture shows, for readers who cannot see it; already escaped.

    Returns
    -------
    str
        The ``<svg>`` element, without prologue, metadata, namespaces and the names of groups.

    Raises
    ------
    ValueError
        If the document is not one that `svg` makes.

    """
    element = document[document.index('<svg'):]
    element = re.sub(r'\s*<metadata>.*?</metadata>', '', element, flags=re.DOTALL)
    element = re.sub(r'<g id="[^"]*"', '<g', element)
    opening = re.match(r'<svg [^>]*?(viewBox="0 0 ([0-9.]+) [0-9.]+")[^>]*>', element)
    if opening is None:
        raise ValueError(f'the document begins with {element[:60]!r}, it must be an SVG of svg()')
    width_rem = float(opening[2]) * _PAGE_REM_PER_POINT
    element = (f'<svg {opening[1]} style="max-width: {width_rem:.2f}rem" role="img" '
               f'aria-label="{description}">{element[opening.end():]}')
    for fixed, from_page in _PAGE_COLOURS.items():
        element = element.replace(fixed, from_page)
    return element.strip()
