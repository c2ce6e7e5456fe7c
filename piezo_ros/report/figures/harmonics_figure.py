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

"""Draws the error over the number of harmonics of the feedforward, (13) in Liu 2015."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from piezo_ros import paper
from piezo_ros.report.figures.panels import add_head, panel_grid, percent_axis
from piezo_ros.report.figures.style import INK, SERIES, figure_style

__all__ = ['HarmonicsCurve', 'harmonics_figure']

# Any: Matplotlib's types do not accept a dictionary of settings.
_CHOSEN_MARK: Final[Any] = {
    'linestyle': 'none', 'marker': 'o', 'markersize': 9.0, 'markerfacecolor': 'none',
    'markeredgecolor': INK, 'markeredgewidth': 1.4}


class HarmonicsCurve(NamedTuple):
    """
    Error over the number of harmonics at one operating point.

    Attributes
    ----------
    label : str
        The operating point.
    harmonics, predicted_percent, measured_percent : array_like, shape (N,)
        m, and the NRMSE predicted and measured, percent; NaN where not measured.
    chosen : int
        The chosen m; one of `harmonics`.

    """

    label: str
    harmonics: ArrayLike
    predicted_percent: ArrayLike
    measured_percent: ArrayLike
    chosen: int


def harmonics_figure(curves: Sequence[HarmonicsCurve]) -> Figure:
    """
    Draw the error over the number of harmonics of the feedforward.

    Parameters
    ----------
    curves : sequence of HarmonicsCurve
        One for each panel, at least one.

    Returns
    -------
    Figure
        Predicted errors as lines, measured ones as dots, a ring around the chosen number, and a
        dashed vertical line at the number of the paper.

    Raises
    ------
    ValueError
        If there is no curve, or a chosen number is not one of the harmonics.

    """
    if not curves:
        raise ValueError('curves is empty, a figure needs at least one curve')
    with figure_style():
        figure, panels, _ = panel_grid(
            len(curves), x_label='harmonics up to m', y_label='NRMSE (%)')
        for panel, curve in zip(panels, curves, strict=True):
            harmonics = np.asarray(curve.harmonics)
            predicted = np.asarray(curve.predicted_percent, dtype=np.float64)
            measured = np.asarray(curve.measured_percent, dtype=np.float64)
            if curve.chosen not in harmonics:
                raise ValueError(
                    f'{curve.label}: chosen is {curve.chosen}, it must be one of '
                    f'{harmonics.tolist()}')
            panel.axvline(paper.HARMONICS, color=INK, linewidth=0.8, linestyle='dashed', alpha=0.6)
            panel.plot(harmonics, predicted, color=SERIES[0])
            panel.plot(harmonics, measured, color=SERIES[3], linestyle='none', marker='o',
                       markersize=4.0)
            at = harmonics == curve.chosen
            panel.plot(harmonics[at], predicted[at], **_CHOSEN_MARK)
            panel.set_title(curve.label, loc='left', fontsize=9.5, pad=3)
            panel.set_title(f'm = {curve.chosen}', loc='right', fontsize=9.5, fontweight='bold',
                            pad=3)
        percent_axis(panels[0])
        add_head(figure, [
            Line2D([], [], color=SERIES[0], label='predicted'),
            Line2D([], [], color=SERIES[3], linestyle='none', marker='o', markersize=4.0,
                   label='measured'),
            Line2D([], [], label='chosen', **_CHOSEN_MARK),
            Line2D([], [], color=INK, linewidth=0.8, linestyle='dashed', alpha=0.6,
                   label=f'm = {paper.HARMONICS}, as in the paper')])
    return figure
