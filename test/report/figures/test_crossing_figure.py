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

import numpy as np
import pytest

from piezo_ros.paper import TABLE_3
from piezo_ros.report.figures.crossing_figure import CrossingRow, crossing_figure
from piezo_ros.report.figures.export import png


def row(amplitude_um=1.0, crossing_hz=600.0):
    frequency_hz = np.arange(300.0, 900.0, 100.0)
    return CrossingRow(
        amplitude_um, frequency_hz, np.full(6, 2.0), 2.0 * frequency_hz / 600.0,
        TABLE_3.get(amplitude_um), crossing_hz)


def horizontal_extent(patch):
    # Before Matplotlib 3.9 a span is a polygon, since then a rectangle.
    corners = patch.get_patch_transform().transform(patch.get_path().vertices)
    return corners[:, 0].min(), corners[:, 0].max()


def test_the_same_rows_give_the_same_picture(assert_reproducible):
    assert_reproducible(lambda: crossing_figure([row(), row(1.5, None), row(7.0)]))


def test_the_crossing_lies_on_the_curve_and_the_published_band_behind_it(words):
    figure = crossing_figure([row(1.0), row(2.0, None)])
    panel, other, summary = figure.axes
    mark = panel.get_lines()[-1]
    assert (*mark.get_xdata(), *mark.get_ydata()) == pytest.approx((600.0, 2.0))
    (band,) = panel.patches
    assert horizontal_extent(band) == pytest.approx(TABLE_3[1.0])
    assert 'no crossing' in words(figure)
    assert not other.patches  # one published frequency is a line
    assert 650.0 in [line.get_xdata()[0] for line in other.get_lines()]
    assert [list(line.get_xdata()) for line in summary.get_lines()] == [[600.0]]


def test_a_figure_without_rows_is_refused():
    with pytest.raises(ValueError, match='rows is empty'):
        crossing_figure([])


def test_a_single_row_can_be_drawn():
    figure = crossing_figure([CrossingRow(0.7, [300.0], [2.0], [1.0], None, None)])
    assert png(figure).startswith(b'\x89PNG')
