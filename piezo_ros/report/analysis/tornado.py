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

"""Draws the tornado plot of a sweep: the score at either end of each drawn parameter."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from piezo_ros.report.analysis.draw_statistics import Dependence
from piezo_ros.report.figures.panels import WIDTH_IN
from piezo_ros.report.figures.style import INK, SERIES, figure_style

__all__ = ['tornado_figure']

_MOST_BARS = 15


def tornado_figure(found: Sequence[Dependence]) -> Figure:
    """
    Draw the median NRMSE at either end of each parameter, the widest bar above.

    Parameters
    ----------
    found : sequence of Dependence
        At least one.

    Returns
    -------
    Figure
        One bar a parameter.

    """
    bars = sorted(found, key=lambda each: each.span)[-_MOST_BARS:]
    height_in = 0.95 + 0.34 * len(bars)
    with figure_style():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        left = 0.02 + 0.0105 * max(len(each.name) for each in bars)
        axes = figure.add_axes((
            left, 0.5 / height_in, 0.985 - left, 1.0 - 0.85 / height_in))
        for place, each in enumerate(bars):
            ends = (each.at_lowest, each.at_highest, each.median)
            axes.barh(
                place, max(ends) - min(ends), left=min(ends), height=0.56, color=SERIES[0],
                alpha=0.3)
            axes.plot(
                each.at_lowest, place, marker='o', color=SERIES[0], markerfacecolor='none',
                linestyle='none', markersize=7, markeredgewidth=1.6, clip_on=False,
                label='parameter lowest' if not place else None)
            axes.plot(
                each.at_highest, place, marker='o', color=SERIES[0], linestyle='none',
                markersize=4.5, clip_on=False, label='parameter highest' if not place else None)
        axes.axvline(bars[0].median, color=INK, linewidth=0.9, linestyle='dashed',
                     label='all draws')
        axes.set_yticks(range(len(bars)), [each.name for each in bars])
        axes.grid(axis='y', visible=False)
        axes.set_xlabel('median NRMSE (%)')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=3, borderpad=0,
                    borderaxespad=0.3)
    return figure
