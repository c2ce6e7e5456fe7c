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
"""What lines of all interactive panels have in common: points, look, form in the page."""

import base64
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.figures.style import INK, LINE_STYLES
from piezo_ros.report.page.colours import page_colour

__all__ = ['MARKERS', 'STYLES', 'DrawnLine', 'as_base64']

STYLES: Final = (*LINE_STYLES, 'none')
MARKERS: Final = ('', 'filled', 'open')


@dataclass(frozen=True)
class DrawnLine:
    """
    Points of a panel, joined or as markers.

    Attributes
    ----------
    label : str
        Its name in the legend.
    x, y : array_like, shape (N,)
        The points.
    colour : str
        ``'#rrggbb'``. Colours of `piezo_ros.report.figures.style` follow the dark mode.
    style : str
        ``'solid'``, ``'dashed'``, ``'dotted'``, ``'dashdot'``, or ``'none'`` for markers alone.
    marker : str
        ``''`` (none), ``'filled'`` or ``'open'``.
    width_px : float
        Width of the line, pixels.

    """

    label: str
    x: ArrayLike
    y: ArrayLike
    colour: str = INK
    style: str = 'solid'
    marker: str = ''
    width_px: float = 1.5

    @property
    def look(self) -> dict[str, Any]:
        """All but the points, for the script of a page."""
        return {
            'label': self.label, 'colour': page_colour(self.colour), 'style': self.style,
            'marker': self.marker, 'width': self.width_px}


def as_base64(values: NDArray[np.float64]) -> str:
    """Return values as little-endian 32-bit floats; what is not finite becomes NaN."""
    limit = np.finfo(np.float32).max
    single = np.clip(np.where(np.isfinite(values), values, np.nan), -limit, limit)
    return base64.b64encode(single.astype('<f4').tobytes()).decode()
