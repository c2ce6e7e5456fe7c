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
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from matplotlib.figure import Figure
from matplotlib.text import Text

from piezo_ros.report.figures.style import figure_style

__all__ = ['png', 'svg']

_DOTS_PER_INCH: Final = 160
# XML cannot contain them, not even escaped.
_NO_TEXT: Final = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]')


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
    with figure_style(salt=name), _as_plain_text(figure):
        figure.savefig(
            buffer, format='svg', dpi=_DOTS_PER_INCH,  # of rasterised points
            metadata={'Date': None, 'Creator': None})
    return buffer.getvalue().decode()


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    with figure_style(), _as_plain_text(figure):
        figure.savefig(buffer, format='png', dpi=_DOTS_PER_INCH, metadata={'Software': None})
    return buffer.getvalue()


@contextmanager
def _as_plain_text(figure: Figure) -> Iterator[None]:
    """
    Have the texts of a figure drawn as they are: they come from bags and plans.

    Matplotlib takes what stands between two dollar signs for a formula. The labels of ticks, which
    may be formulas, are made anew while the figure is drawn.
    """
    before = [(text, text.get_text()) for text in figure.findobj(Text) if isinstance(text, Text)]
    for text, words in before:
        text.set_text(_NO_TEXT.sub('\N{REPLACEMENT CHARACTER}', words).replace('$', r'\$'))
    try:
        yield
    finally:
        for text, words in before:
            text.set_text(words)
