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
"""Draws raster scans: images, maps of their distortion, and the deviation along a line."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from piezo_ros.report.figures.panels import WIDTH_IN, percent_axis
from piezo_ros.report.figures.style import LINE_STYLES, SERIES, figure_style
from piezo_ros.report.scanned_image import ScannedImage

__all__ = ['comparison_figure', 'deviation_figure', 'scan_figure']

_Floats = NDArray[np.float64]

# Both are told apart with any colour vision; heights of a grey scale are, too.
_HEIGHTS: Final = 'cividis'
_DIFFERENCES: Final = 'PuOr'
_NM_PER_UM: Final = 1e3
_SPREAD: Final = 99.5  # percentile of a map that its colours reach
_LEAST_PX: Final = 1e-3  # below it a map has one colour
_LEFT: Final = 0.085
_ANISOTROPIC: Final = 4.0  # beyond it an image does not keep its proportions


class _Panel(NamedTuple):
    """One map of a figure."""

    title: str
    values: _Floats
    unit: str
    is_difference: bool


def scan_figure(scan: ScannedImage) -> Figure:
    """
    Draw trace, retrace and what is wrong with them.

    Parameters
    ----------
    scan : ScannedImage
        The scan.

    Returns
    -------
    Figure
        Two rows of three maps, each with its colour bar.

    """
    images, sample = scan.images, scan.sample
    trace_um = images.trace(sample)
    x_px, y_px = images.trace_deviation_px
    back_px, _ = images.retrace_deviation_px
    panels = (
        _Panel('trace', _NM_PER_UM * trace_um, 'height (nm)', False),
        _Panel('retrace', _NM_PER_UM * images.retrace(sample), 'height (nm)', False),
        _Panel('trace less ideal', _NM_PER_UM * (trace_um - images.ideal(sample)),
               'height (nm)', True),
        _Panel('deviation along x', x_px, 'pixels', True),
        _Panel('deviation along y', y_px, 'lines', True),
        _Panel('retrace less trace, x', back_px - x_px, 'pixels', True))
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 4.2))
        axes = figure.subplots(
            2, 3, sharex=True, sharey=True,
            gridspec_kw={'left': _LEFT, 'right': 0.915, 'top': 0.945, 'bottom': 0.09,
                         'wspace': 0.62, 'hspace': 0.2})
        for place, panel in zip(axes.flat, panels, strict=True):
            _draw(figure, place, scan, panel, _limits([panel]))
        for place in axes[1]:
            place.set_xlabel('x (µm)')
        for place in axes[:, 0]:
            place.set_ylabel('y (µm)')
    return figure


def comparison_figure(scans: Sequence[ScannedImage]) -> Figure:
    """
    Draw the trace of several scans of one sample beside the ideal image.

    Parameters
    ----------
    scans : sequence of ScannedImage
        Scans of one case, at least one.

    Returns
    -------
    Figure
        The ideal image and the traces with a common scale of heights, below them the traces less
        their ideal images.

    Raises
    ------
    ValueError
        If there is no scan.

    """
    if not scans:
        raise ValueError('scans is empty, a figure needs at least one scan')
    traces_um = [scan.images.trace(scan.sample) for scan in scans]
    ideals_um = [scan.images.ideal(scan.sample) for scan in scans]
    seen = [_Panel('ideal', _NM_PER_UM * ideals_um[0], 'height (nm)', False)]
    seen += [_Panel(scan.variant, _NM_PER_UM * trace_um, 'height (nm)', False)
             for scan, trace_um in zip(scans, traces_um, strict=True)]
    less = [_Panel(f'{scan.variant}, less ideal', _NM_PER_UM * (trace_um - ideal_um),
                   'difference (nm)', True)
            for scan, trace_um, ideal_um in zip(scans, traces_um, ideals_um, strict=True)]
    columns = len(seen)
    height_in = 0.75 + 2.0 * _square_in(columns)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        axes = figure.subplots(
            2, columns, sharex=True, sharey=True, squeeze=False,
            gridspec_kw={'left': _LEFT, 'right': 0.9, 'top': 1.0 - 0.22 / height_in,
                         'bottom': 0.43 / height_in, 'wspace': 0.08, 'hspace': 0.22})
        axes[1, 0].set_visible(False)
        axes[0, 0].tick_params(labelbottom=True)
        axes[1, 1].tick_params(labelleft=True)
        for row, panels, members in ((axes[0], seen, [scans[0], *scans]),
                                     (axes[1, 1:], less, scans)):
            limits = _limits(panels)
            for place, panel, scan in zip(row, panels, members, strict=True):
                drawn = _show(place, scan, panel, limits)
            box = row[-1].get_position()
            bar = figure.colorbar(
                drawn, cax=figure.add_axes((0.912, box.y0, 0.014, box.height)))
            _finish_bar(bar, panels[0].unit)
        for place in (axes[0, 0], *axes[1, 1:]):
            place.set_xlabel('x (µm)')
        axes[0, 0].set_ylabel('y (µm)')
    return figure


def deviation_figure(scans: Sequence[ScannedImage]) -> Figure:
    """
    Draw how far the tip is off along a line: mean over all lines, for trace and retrace.

    Parameters
    ----------
    scans : sequence of ScannedImage
        Scans of one case, at least one.

    Returns
    -------
    Figure
        One panel, the size of the deviation on a logarithmic axis.

    Raises
    ------
    ValueError
        If there is no scan.

    """
    if not scans:
        raise ValueError('scans is empty, a figure needs at least one scan')
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, 2.9))
        panel = figure.subplots(
            gridspec_kw={'left': 0.09, 'right': 0.985, 'top': 0.87, 'bottom': 0.165})
        for number, scan in enumerate(scans):
            for style, way, (x_px, _) in (
                    (LINE_STYLES[0], 'trace', scan.images.trace_deviation_px),
                    (LINE_STYLES[1], 'retrace', scan.images.retrace_deviation_px)):
                panel.plot(
                    scan.images.nominal_x_um,
                    np.maximum(np.abs(x_px.mean(axis=0)), _LEAST_PX),
                    color=SERIES[(2 * number) % len(SERIES)], linestyle=style,
                    label=f'{scan.variant}, {way}')
        percent_axis(panel)
        panel.set_xlabel('x (µm)')
        panel.set_ylabel('|deviation along x| (pixels)')
        panel.set_xlim(scans[0].images.nominal_x_um[0], scans[0].images.nominal_x_um[-1])
        panel.legend(
            loc='lower left', bbox_to_anchor=(0, 1), ncol=3, borderpad=0, borderaxespad=0.35,
            handlelength=2.2, columnspacing=1.8, fontsize=8.5)
    return figure


def _limits(panels: Sequence[_Panel]) -> tuple[float, float]:
    """Return the ends of the colours: about zero for differences."""
    values = np.concatenate([panel.values.ravel() for panel in panels])
    if panels[0].is_difference:
        most = max(float(np.percentile(np.abs(values), _SPREAD)), _LEAST_PX)
        return -most, most
    return float(values.min()), float(values.max())


def _draw(
    figure: Figure, place: Axes, scan: ScannedImage, panel: _Panel, limits: tuple[float, float],
) -> None:
    drawn = _show(place, scan, panel, limits)
    low, high = float(panel.values.min()), float(panel.values.max())
    beyond = {(False, False): 'neither', (True, False): 'min', (False, True): 'max',
              (True, True): 'both'}[low < limits[0], high > limits[1]]
    bar = figure.colorbar(
        drawn, cax=place.inset_axes((1.04, 0.0, 0.055, 1.0)), extend=beyond)
    _finish_bar(bar, panel.unit)


def _show(
    place: Axes, scan: ScannedImage, panel: _Panel, limits: tuple[float, float],
) -> Any:
    x_um, y_um = scan.images.nominal_x_um, scan.images.nominal_y_um
    half_x_um = 0.5 * scan.images.pixel_um
    half_y_um = 0.5 * (y_um[-1] - y_um[0]) / (y_um.size - 1)
    # With the first line at its own place: at the bottom if the slow axis ascends.
    ratio = abs(y_um[-1] - y_um[0]) / (x_um[-1] - x_um[0])
    drawn = place.imshow(
        panel.values, origin='lower', interpolation='nearest',
        aspect='equal' if 1.0 / _ANISOTROPIC < ratio < _ANISOTROPIC else 'auto',
        cmap=_DIFFERENCES if panel.is_difference else _HEIGHTS, vmin=limits[0], vmax=limits[1],
        extent=(x_um[0] - half_x_um, x_um[-1] + half_x_um,
                y_um[0] - half_y_um, y_um[-1] + half_y_um))
    if y_um[-1] < y_um[0]:
        place.invert_yaxis()
    place.grid(visible=False)
    place.set_title(panel.title, loc='left', fontsize=8.5, pad=3)
    place.locator_params(nbins=4)
    return drawn


def _square_in(columns: int) -> float:
    """Return the height of panels side by side that are about square, with their titles."""
    return (0.9 - _LEFT) * WIDTH_IN / (1.08 * columns) + 0.2


def _finish_bar(bar: Any, unit: str) -> None:
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=8.0)
    bar.ax.grid(visible=False)
    bar.set_label(unit, fontsize=8.5, labelpad=2)
