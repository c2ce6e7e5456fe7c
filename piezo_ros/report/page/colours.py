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
"""Replaces the colours of figures by those of the page, which are other ones in dark mode."""

from typing import Final

from piezo_ros.report.figures.style import (
    BACKGROUND,
    FAINT,
    GRID,
    INK,
    SCHEME_COLOURS,
    SERIES,
)

__all__ = ['PAGE_COLOURS', 'page_colour']

# Colour of a figure -> its value on the page. report.css sets the variables for light and dark
# systems.
PAGE_COLOURS: Final = {
    INK: 'currentColor', GRID: 'var(--grid)', FAINT: 'var(--faint)', BACKGROUND: 'none'} | {
    colour: f'var(--{scheme.replace("_", "-")}, {colour})'
    for scheme, colour in SCHEME_COLOURS.items()} | {
    colour: f'var(--series-{number}, {colour})' for number, colour in enumerate(SERIES, start=1)}


def page_colour(colour: str) -> str:
    """Return the value on the page of a colour '#rrggbb': a variable of report.css, or itself."""
    return PAGE_COLOURS.get(colour, colour)
