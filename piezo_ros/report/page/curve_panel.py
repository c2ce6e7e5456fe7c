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
"""
Interactive panels of curves with an abscissa in any order, such as loops and Nyquist diagrams.

Where the mouse is, the page tells the nearest point of a curve and, where it is given, the value
that runs along the curve there: time or frequency.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.report.page.drawn_line import MARKERS, STYLES, DrawnLine, as_base64

__all__ = ['Curve', 'CurvePanel', 'curve_panel_content']

_MOST_POINTS: Final = 4000
_PANEL_HEIGHT_PX: Final = 340


@dataclass(frozen=True)
class Curve(DrawnLine):
    """
    One curve of a panel, or a set of markers.

    Attributes
    ----------
    x, y : array_like, shape (N,)
        The points, in the order in which they are joined. A point that is not finite is a gap.
    label, colour, style, marker, width_px
        As of `DrawnLine`.
    along : array_like, shape (N,), optional
        What runs along the curve, such as the frequency; told where the mouse is.

    """

    along: ArrayLike | None = None


@dataclass(frozen=True)
class CurvePanel:
    """
    One pair of axes with curves in a plane.

    Attributes
    ----------
    x_label, y_label : str
        Labels of the axes, with units.
    curves : sequence of Curve
        At least one.
    title : str
        Above the panel; may be empty.
    along_label : str
        What `Curve.along` is, with its unit.
    x_range, y_range : (float, float) or None
        The range at first; None shows all points.
    has_equal_scales : bool
        Whether a unit is as long on one axis as on the other; circles are round then.
    height_px : int
        Height, pixels.

    """

    x_label: str
    y_label: str
    curves: Sequence[Curve]
    title: str = ''
    along_label: str = ''
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    has_equal_scales: bool = False
    height_px: int = _PANEL_HEIGHT_PX


def curve_panel_content(panel: CurvePanel) -> dict[str, Any]:
    """
    Return what the script of a page draws of a panel, for JSON.

    Parameters
    ----------
    panel : CurvePanel
        A curve of more than 4 000 points is thinned evenly.

    Raises
    ------
    ValueError
        If a curve cannot be drawn; the message names it.

    """
    curves = [_content(curve) for curve in panel.curves]
    return {
        'kind': 'curves', 'title': panel.title, 'x_label': panel.x_label,
        'y_label': panel.y_label, 'along_label': panel.along_label,
        'x_range': _range(panel.x_range, [curve.x for curve in panel.curves]),
        'y_range': _range(panel.y_range, [curve.y for curve in panel.curves]),
        'equal': panel.has_equal_scales, 'height': panel.height_px, 'curves': curves}


def _content(curve: Curve) -> dict[str, Any]:
    if curve.style not in STYLES or curve.marker not in MARKERS:
        raise ValueError(
            f'style and marker of curve {curve.label!r} are {curve.style!r} and {curve.marker!r}, '
            f'they must be of {", ".join(STYLES)} and '
            f'{", ".join(map(repr, MARKERS))}')
    along = [] if curve.along is None else [np.asarray(curve.along, dtype=np.float64)]
    x, y = np.asarray(curve.x, dtype=np.float64), np.asarray(curve.y, dtype=np.float64)
    if x.ndim != 1 or not x.size or any(values.shape != x.shape for values in (y, *along)):
        shapes = ', '.join(str(values.shape) for values in (x, y, *along))
        raise ValueError(
            f'x, y and along of curve {curve.label!r} have the shapes {shapes}, they must be one '
            'shape (N,), N >= 1')
    stride = math.ceil(x.size / _MOST_POINTS)
    return {
        **curve.look, 'x': as_base64(x[::stride]),
        'y': as_base64(y[::stride]), 'along': [as_base64(values[::stride]) for values in along]}


def _range(given: tuple[float, float] | None, values: Sequence[ArrayLike]) -> list[float]:
    """Return the given range, else that of all finite values and some margin."""
    if given is not None:
        return [float(end) for end in given]
    every: NDArray[np.float64] = np.concatenate(
        [np.asarray(each, dtype=np.float64) for each in values])
    every = every[np.isfinite(every)]
    if not every.size:
        return [-1.0, 1.0]
    low, high = float(every.min()), float(every.max())
    margin = 0.05 * (high - low) or 1.0
    return [low - margin, high + margin]
