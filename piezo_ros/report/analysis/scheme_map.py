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

"""Draws which scheme to use over amplitude and frequency, with the predicted errors."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from piezo_ros.identification import OperatingPoint
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import BACKGROUND, INK, figure_style, scheme_colour
from piezo_ros.report.labels import scheme_label

__all__ = ['scheme_map_figure']

_HATCHES = {'ff': '', 'fbff': '..', 'fb': '//'}


def scheme_map_figure(points: Sequence[OperatingPoint]) -> Figure:
    """
    Draw a cell for each operating point, coloured and hatched by its scheme.

    Parameters
    ----------
    points : sequence of OperatingPoint
        Several amplitudes and frequencies.

    Returns
    -------
    Figure
        Each cell names the scheme, the predicted NRMSE and where it is expected.

    """
    amplitudes = sorted({point.amplitude_um for point in points})
    frequencies = sorted({point.frequency_hz for point in points})
    height_in = 0.95 + 0.72 * len(amplitudes)
    seen: set[str] = set()
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        axes = figure.add_axes((0.085, 0.5 / height_in, 0.905, 1.0 - 0.85 / height_in))
        for point in points:
            x, y = frequencies.index(point.frequency_hz), amplitudes.index(point.amplitude_um)
            colour, mark = scheme_colour(point.scheme), '!' if point.chosen.is_limited else ''
            axes.add_patch(Rectangle(
                (x, y), 1.0, 1.0, facecolor=colour, alpha=0.22, edgecolor=BACKGROUND,
                hatch=_HATCHES.get(point.scheme, 'xx'), linewidth=1.2,
                label=None if point.scheme in seen else scheme_label(point.scheme)))
            seen.add(point.scheme)
            doubt = '?' if point.depends_on_place else ''
            axes.text(
                x + 0.5, y + 0.72, f'{scheme_label(point.scheme)}{doubt}{mark}', ha='center',
                va='center', fontsize=9.0, fontweight='bold', color=INK)
            axes.text(
                x + 0.5, y + 0.32, f'{point.nrmse_percent:.2f} %\n{point.interval}', ha='center',
                va='center', fontsize=7.6, color=INK)
        axes.set_xlim(0, len(frequencies))
        axes.set_ylim(0, len(amplitudes))
        axes.set_xticks([place + 0.5 for place in range(len(frequencies))],
                        [f'{value:g}' for value in frequencies])
        axes.set_yticks([place + 0.5 for place in range(len(amplitudes))],
                        [f'{value:g}' for value in amplitudes])
        axes.grid(visible=False)
        axes.set_xlabel('frequency (Hz)')
        axes.set_ylabel('amplitude (µm)')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=len(seen), borderpad=0,
                    borderaxespad=0.4)
    return figure
