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

"""Turns the SVG document of a figure into an element that takes its colours from the page."""

import re
from typing import Final

from markupsafe import Markup

from piezo_ros.report.page.colours import PAGE_COLOURS
from piezo_ros.report.page.rendering import render

__all__ = ['inline_svg']

# Letters of 9.5 pt in a figure are then as large as small print on the page.
_PAGE_REM_PER_POINT: Final = 0.102


def inline_svg(document: str, description: str) -> Markup:
    """
    Turn a stand-alone SVG document into an element of the page.

    Parameters
    ----------
    document : str
        What `piezo_ros.report.figures.export.svg` returned.
    description : str
        What the figure shows, for screen readers.

    Returns
    -------
    Markup
        The ``<svg>`` element, without prologue, metadata, namespaces and the names of groups.

    Raises
    ------
    ValueError
        If the document is not one that `piezo_ros.report.figures.export.svg` makes.

    """
    element = document[document.index('<svg'):]
    element = re.sub(r'\s*<metadata>.*?</metadata>', '', element, flags=re.DOTALL)
    element = re.sub(r'<g id="[^"]*"', '<g', element)
    opening = re.match(r'<svg [^>]*?viewBox="(0 0 ([0-9.]+) [0-9.]+)"[^>]*>', element)
    if opening is None:
        raise ValueError(f'the document begins with {element[:60]!r}, it must be an SVG of svg()')
    body = element[opening.end():].strip().removesuffix('</svg>')
    for fixed, from_page in PAGE_COLOURS.items():
        body = body.replace(fixed, from_page)
    return render(
        'inline_svg', view_box=opening[1], width_rem=float(opening[2]) * _PAGE_REM_PER_POINT,
        description=description, body=Markup(body))
