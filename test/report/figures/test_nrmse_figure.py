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

import dataclasses

import pytest

from piezo_ros.paper import TABLE_4
from piezo_ros.report.figures.export import png
from piezo_ros.report.figures.nrmse_figure import TableCell, nrmse_figure, table_4_figure
from piezo_ros.report.figures.style import scheme_colour


def table_cells(factor=1.1):
    return [
        TableCell(amplitude_um, frequency_hz, factor * error.ff, factor * error.fbff, *error)
        for amplitude_um, cells in TABLE_4.items() for frequency_hz, error in cells.items()]


def horizontal_extent(patch):
    # Before Matplotlib 3.9 a span is a polygon, since then a rectangle.
    corners = patch.get_patch_transform().transform(patch.get_path().vertices)
    return corners[:, 0].min(), corners[:, 0].max()


def test_nrmse_puts_the_published_number_at_the_frequency_of_ours(scored_runs):
    ff = scored_runs[1]
    at_500 = dataclasses.replace(
        ff, frequency_hz=500.0, nrmse_percent=3.0, paper_nrmse_percent=2.71)
    ours, paper = nrmse_figure([at_500, ff]).axes[0].get_lines()[:2]
    assert list(ours.get_xdata()) == list(paper.get_xdata()) == [300.0, 500.0]
    assert list(ours.get_ydata()) == [ff.nrmse_percent, 3.0]
    assert list(paper.get_ydata()) == [2.10, 2.71]


def test_the_same_cells_give_the_same_picture(assert_reproducible):
    assert_reproducible(lambda: table_4_figure(table_cells(), title='Table 4'))


def test_table_4_has_every_cell_ours_and_published(words):
    cells = table_cells()
    figure = table_4_figure(cells, title='Table 4 as published')
    *panels, every = figure.axes
    assert len(panels) == 5
    ours, published = panels[0].get_lines()[:2]
    assert list(ours.get_ydata()) == [cell.ff for cell in cells[:6]]
    assert list(published.get_ydata()) == [cell.paper_ff for cell in cells[:6]]
    assert ours.get_color() == published.get_markeredgecolor() == scheme_colour('ff')
    assert sum(line.get_xdata().size for line in every.get_lines()[:2]) == 60
    assert 'Table 4 as published' in words(figure)


def test_another_winner_than_the_published_one_is_shaded(words):
    cells = table_cells()
    assert not [patch for panel in table_4_figure(cells, title='').axes for patch in panel.patches]
    wrong = cells[0]._replace(ff=1.0, fbff=2.0)
    assert cells[0].same_winner
    assert not wrong.same_winner
    figure = table_4_figure([wrong, *cells[1:]], title='')
    (shade,) = figure.axes[0].patches
    assert sum(horizontal_extent(shade)) / 2 == pytest.approx(wrong.frequency_hz)
    assert 'another winner' in words(figure)


def test_a_table_without_cells_is_refused():
    with pytest.raises(ValueError, match='cells is empty'):
        table_4_figure([], title='')


def test_a_single_cell_can_be_drawn():
    figure = table_4_figure([TableCell(1.0, 300.0, 2.0, 1.0, 2.1, 1.1)], title='t')
    assert png(figure).startswith(b'\x89PNG')
