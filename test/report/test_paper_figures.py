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

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from piezo_ros.paper import TABLE_3, TABLE_4
from piezo_ros.report.paper_figures import (
    BoundCurve,
    CrossingRow,
    HarmonicsCurve,
    Loop,
    ResponseCurve,
    TableCell,
    crossing_figure,
    harmonics_figure,
    loops_figure,
    response_figure,
    straight_line_deviation,
    table_4_figure,
    uncertainty_figure,
)
from piezo_ros.report.rendering import SERIES, inline_svg, png, scheme_colour, svg
from piezo_ros.report.response_figures import magnitude_and_phase

FREQUENCY_HZ = np.geomspace(10.0, 3000.0, 40)
RESPONSE = 0.9 / (1.0 + 1j * FREQUENCY_HZ / 300.0)**3


def loop(width=0.2, label='voltage (V)'):
    phase = np.linspace(0.0, 2.0 * np.pi, 20001)
    return Loop(3.0 * np.sin(phase), 2.7 * np.sin(phase - width), label, 11.9, 12.5)


def row(amplitude_um=1.0, crossing_hz=600.0):
    frequency_hz = np.arange(300.0, 900.0, 100.0)
    return CrossingRow(
        amplitude_um, frequency_hz, np.full(6, 2.0), 2.0 * frequency_hz / 600.0,
        TABLE_3.get(amplitude_um), crossing_hz)


def table_cells(factor=1.1):
    return [
        TableCell(amplitude_um, frequency_hz, factor * error.ff, factor * error.fbff, *error)
        for amplitude_um, cells in TABLE_4.items() for frequency_hz, error in cells.items()]


def horizontal_extent(patch):
    # Before Matplotlib 3.9 a span is a polygon, since then a rectangle.
    corners = patch.get_patch_transform().transform(patch.get_path().vertices)
    return corners[:, 0].min(), corners[:, 0].max()


def harmonics_curve(chosen=9):
    m = np.arange(1, 20, 2)
    return HarmonicsCurve('2.5 µm, 300 Hz', m, 5.0 / m, np.where(m % 3, 5.1 / m, np.nan), chosen)


DRAWINGS = {
    'loops': lambda: loops_figure(loop(), loop(0.001, 'command (µm)')),
    'response': lambda: response_figure(
        [ResponseCurve('1 µm', FREQUENCY_HZ, RESPONSE, 0.01 * np.abs(RESPONSE)),
         ResponseCurve('G', FREQUENCY_HZ, RESPONSE, 0.02 * np.abs(RESPONSE), 'line')],
        title='G'),
    'uncertainty': lambda: uncertainty_figure(
        np.tile(FREQUENCY_HZ, 100), 0.1 * np.tile(RESPONSE, 100),
        [BoundCurve('W', FREQUENCY_HZ, np.full(40, 0.2))]),
    'crossing': lambda: crossing_figure([row(), row(1.5, None), row(7.0)]),
    'table_4': lambda: table_4_figure(table_cells(), title='Table 4'),
    'harmonics': lambda: harmonics_figure([harmonics_curve()]),
}


def words(figure):
    return ' '.join(ElementTree.fromstring(svg(figure, 'a')).itertext())


@pytest.mark.parametrize('name', DRAWINGS)
def test_the_same_arrays_give_the_same_picture(name):
    first, second = (svg(DRAWINGS[name](), 'a') for _ in range(2))
    assert first == second
    assert 'dc:date' not in first
    ElementTree.fromstring(first)
    assert 'http' not in inline_svg(first, 'what it shows')


def test_what_is_rasterised_is_the_same_as_png_too():
    assert png(DRAWINGS['uncertainty']()) == png(DRAWINGS['uncertainty']())


def test_a_loop_stands_beside_its_published_nonlinearity():
    text = words(DRAWINGS['loops']())
    for number in ('11.90', '12.50', '11.84', '13.14', '0.40', '0.38'):
        assert f'{number} %' in text


def test_deviation_from_a_straight_line_leaves_out_slope_and_offset():
    x = np.linspace(-1.0, 1.0, 101)
    assert straight_line_deviation(x, 3.0 * x + 5.0) == pytest.approx(np.zeros(101), abs=1e-12)
    bent = straight_line_deviation(x, x**2 + x)
    assert bent == pytest.approx(x**2 - np.mean(x**2), abs=1e-12)


def test_a_long_record_is_thinned_and_keeps_its_extremes():
    top = DRAWINGS['loops']().axes[0]
    (line,) = top.get_lines()
    assert line.get_xdata().size <= 2000
    assert np.ptp(line.get_xdata()) == pytest.approx(6.0, rel=1e-4)


def test_phase_is_unwrapped_and_confidence_becomes_an_angle():
    curve = ResponseCurve('G', FREQUENCY_HZ, RESPONSE, 0.5 * np.abs(RESPONSE))
    polar = magnitude_and_phase(curve)
    expected = -3.0 * np.degrees(np.arctan(FREQUENCY_HZ / 300.0))
    assert polar.phase_deg == pytest.approx(expected)
    assert polar.phase_deg.min() < -180.0
    assert polar.phase_radius_deg == pytest.approx(np.full(40, 30.0))
    unknown = magnitude_and_phase(curve._replace(confidence_radius=2.0 * np.abs(RESPONSE)))
    assert unknown.phase_radius_deg == pytest.approx(np.full(40, 180.0))


def test_a_response_of_large_range_is_in_decibels_and_a_flat_one_is_not():
    steep = DRAWINGS['response']().axes[0]
    assert steep.get_ylabel() == 'magnitude (dB)'
    assert steep.get_lines()[0].get_ydata() == pytest.approx(20.0 * np.log10(np.abs(RESPONSE)))
    flat = response_figure(
        [ResponseCurve('bare', FREQUENCY_HZ, RESPONSE[:1] * np.ones(40))], title='', unit='µm/V')
    assert flat.axes[0].get_ylabel() == 'magnitude (µm/V)'
    assert flat.axes[0].get_ylim()[0] == 0.0


def test_as_many_models_as_measurements_pair_in_colour_and_a_lone_one_is_ink():
    def colours(*curves):
        return [line.get_color() for line in response_figure(curves, title='').axes[0].get_lines()]

    points = ResponseCurve('points', FREQUENCY_HZ, RESPONSE)
    line = points._replace(label='line', style='line')
    assert colours(points, line, points, line) == [SERIES[0], SERIES[0], SERIES[1], SERIES[1]]
    assert colours(points, points, line)[:2] == [SERIES[0], SERIES[1]]
    assert colours(points, points, line)[2] not in SERIES


def test_many_points_become_a_picture_inside_the_drawing_and_few_do_not():
    def images(points):
        figure = uncertainty_figure(
            np.geomspace(10.0, 1e3, points), np.full(points, 0.1), [])
        return svg(figure, 'a').count('<image ')

    assert images(100) == 0
    assert images(5000) == 1


@pytest.mark.parametrize('count', [1, 6, 13])
@pytest.mark.parametrize('label', ['1 V', '0.25 µm, offset -0.75 µm, measured'])
def test_the_legend_fits_between_heading_and_panel(count, label):
    curves = [ResponseCurve(label, FREQUENCY_HZ, RESPONSE)] * count
    figure = response_figure(curves, title='G')
    svg(figure, 'a')  # only what was drawn has a place
    axes = figure.axes[0]
    legend, panel = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert legend.x1 <= figure.bbox.x1
    assert legend.y0 >= panel.y1 - 0.5
    assert legend.y1 <= axes._left_title.get_window_extent().y0 + 1.0


def test_uncertainty_is_drawn_by_its_magnitude():
    figure = uncertainty_figure([10.0, 20.0], [0.3 + 0.4j, -0.1], [])
    assert figure.axes[0].get_lines()[0].get_ydata() == pytest.approx([0.5, 0.1])


def test_the_crossing_lies_on_the_curve_and_the_published_band_behind_it():
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


def test_table_4_has_every_cell_ours_and_published():
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


def test_another_winner_than_the_published_one_is_shaded():
    cells = table_cells()
    assert not [patch for panel in table_4_figure(cells, title='').axes for patch in panel.patches]
    wrong = cells[0]._replace(ff=1.0, fbff=2.0)
    assert cells[0].same_winner
    assert not wrong.same_winner
    figure = table_4_figure([wrong, *cells[1:]], title='')
    (shade,) = figure.axes[0].patches
    assert sum(horizontal_extent(shade)) / 2 == pytest.approx(wrong.frequency_hz)
    assert 'another winner' in words(figure)


def test_the_chosen_number_of_harmonics_is_ringed_where_it_is_predicted():
    panel = harmonics_figure([harmonics_curve(chosen=5)]).axes[0]
    ring = panel.get_lines()[-1]
    assert (*ring.get_xdata(), *ring.get_ydata()) == (5, 1.0)
    assert panel.get_title(loc='right') == 'm = 5'


@pytest.mark.parametrize(('draw', 'message'), [
    (lambda: response_figure([], title=''), 'curves is empty'),
    (lambda: crossing_figure([]), 'rows is empty'),
    (lambda: table_4_figure([], title=''), 'cells is empty'),
    (lambda: harmonics_figure([]), 'curves is empty'),
    (lambda: harmonics_figure([harmonics_curve(chosen=4)]), 'chosen is 4'),
    (lambda: response_figure([ResponseCurve('a', [1.0], [1.0], style='bars')], title=''),
     "style of a is 'bars'"),
    (lambda: response_figure([ResponseCurve('a', [1.0, 2.0], [1.0])], title=''), r'a: .*\(2,\)'),
    (lambda: response_figure([ResponseCurve('a', [1.0], [1.0], [1.0, 2.0])], title=''),
     'a: confidence_radius'),
    (lambda: uncertainty_figure([1.0], [], []), 'equally long'),
])
def test_what_cannot_be_drawn_is_refused_by_name(draw, message):
    with pytest.raises(ValueError, match=message):
        draw()


def test_a_single_cell_a_single_row_and_lists_can_be_drawn():
    for figure in (
            table_4_figure([TableCell(1.0, 300.0, 2.0, 1.0, 2.1, 1.1)], title='t'),
            crossing_figure([CrossingRow(0.7, [300.0], [2.0], [1.0], None, None)]),
            harmonics_figure([HarmonicsCurve('a', [1], [2.0], [float('nan')], 1)]),
            response_figure([ResponseCurve('a', [100.0], [0j + 1.0])], title=''),
            uncertainty_figure([100.0, 200.0], [0.0, 0.1], [])):
        assert png(figure).startswith(b'\x89PNG')


def test_identifiers_of_two_drawings_differ_also_where_a_picture_is_inside():
    first, second = (
        set(re.findall(r'\bid="([^"]+)"', inline_svg(svg(DRAWINGS['uncertainty'](), name), '')))
        for name in ('a', 'b'))
    assert first
    assert not first & second
