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

"""Draws the results of a benchmark: rates of the graph beside those of the bare transports."""

from collections.abc import Mapping
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from piezo_ros.report.figures.style import FAINT, INK, SERIES, figure_style

__all__ = ['bench_figure']

_BAR_IN: Final = 0.22
_GROUP_TITLES: Final = {
    'composed': 'One process', 'separate': 'A process for each node',
    'blocks': 'Blocks without feedback', 'kernels': 'Kernels', 'bag': 'Bags', 'fits': 'Fits',
    'footprint': 'Footprint', 'services': 'Services', 'sweep': 'Sweep'}


def bench_figure(record: Mapping[str, Any]) -> Figure:
    """
    Draw the groups of a benchmark as bars, one panel for each unit in a group.

    Parameters
    ----------
    record : mapping
        As `benchmarks.benchmark_record.benchmark_record` returns it.

    Returns
    -------
    Figure
        Medians as bars, the range from the smallest to the largest value as a line. Bare
        transports are grey.

    """
    panels: dict[tuple[str, str], list[str]] = {}
    for name, row in record['results'].items():
        if row['group'] != 'yardsticks':
            panels.setdefault((row['group'], row['unit']), []).append(name)
    heights = [len(names) + 1.9 for names in panels.values()]
    machine = record['machine']
    with figure_style():
        figure = Figure(figsize=(7.6, _BAR_IN * sum(heights) + 0.4), layout='constrained')
        figure.suptitle(
            f'piezo_ros benchmarks, {record["date"][:10]}, {machine["cores"]} cores, '
            f'{machine["processor"]}, Python {machine["python"]}', fontsize='medium')
        axes = figure.subplots(
            len(panels), 1, gridspec_kw={'height_ratios': heights}, squeeze=False)[:, 0]
        for panel, ((group, unit), names) in zip(axes, panels.items(), strict=True):
            _bars(panel, record['results'], names)
            panel.set_title(
                f'{_GROUP_TITLES.get(group, group)}, {unit}', loc='left', fontsize='medium')
    return figure


def _bars(panel: Axes, results: Mapping[str, Any], names: list[str]) -> None:
    largest = max(results[name]['maximum'] for name in names)
    for place, name in enumerate(names):
        row = results[name]
        panel.barh(
            place, row['median'], height=0.66,
            color=FAINT if name.startswith('ring_') else SERIES[0])
        panel.plot(
            [row['minimum'], row['maximum']], [place, place], color=INK, linewidth=1.0,
            solid_capstyle='butt')
        panel.text(
            row['maximum'] + 0.01 * largest, place, _short(row['median']), va='center',
            fontsize='small')
    panel.set_yticks(range(len(names)), [name.replace('_', ' ') for name in names])
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.15 * largest)
    panel.xaxis.set_major_locator(MaxNLocator(6))
    panel.xaxis.set_major_formatter(lambda value, _: _short(value))
    panel.grid(visible=False, axis='y')


def _short(value: float) -> str:
    """Return a number with three digits: 6.23 M for 6228000."""
    for factor, letter in ((1e9, ' G'), (1e6, ' M'), (1e3, ' k')):
        if abs(value) >= factor:
            return f'{value / factor:.3g}{letter}'
    return f'{value:.3g}'
