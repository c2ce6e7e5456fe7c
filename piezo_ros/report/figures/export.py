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

"""Exports a figure as SVG or PNG; the same figure gives the same bytes."""

import io
from typing import Final

from matplotlib.figure import Figure

from piezo_ros.report.figures.style import figure_style

__all__ = ['png', 'svg']

_DOTS_PER_INCH: Final = 160


def svg(figure: Figure, name: str) -> str:
    """
    Return a figure as SVG.

    Parameters
    ----------
    figure : Figure
        What to draw.
    name : str
        Seed of the identifiers, so that two figures of one page share none.

    Returns
    -------
    str
        A stand-alone document without a date.

    """
    buffer = io.BytesIO()
    with figure_style(salt=name):
        figure.savefig(
            buffer, format='svg', dpi=_DOTS_PER_INCH,  # of rasterised points
            metadata={'Date': None, 'Creator': None})
    return buffer.getvalue().decode()


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    with figure_style():
        figure.savefig(buffer, format='png', dpi=_DOTS_PER_INCH, metadata={'Software': None})
    return buffer.getvalue()
