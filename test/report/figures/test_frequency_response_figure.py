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

from piezo_ros.report.figures.export import png, svg
from piezo_ros.report.figures.frequency_response_figure import (
    ResponseCurve,
    magnitude_and_phase,
    response_figure,
)
from piezo_ros.report.figures.style import SERIES

FREQUENCY_HZ = np.geomspace(10.0, 3000.0, 40)
RESPONSE = 0.9 / (1.0 + 1j * FREQUENCY_HZ / 300.0)**3


def response_of_points_and_line():
    return response_figure(
        [ResponseCurve('1 µm', FREQUENCY_HZ, RESPONSE, 0.01 * np.abs(RESPONSE)),
         ResponseCurve('G', FREQUENCY_HZ, RESPONSE, 0.02 * np.abs(RESPONSE), 'line')],
        title='G')


def test_the_same_responses_give_the_same_picture(assert_reproducible):
    assert_reproducible(response_of_points_and_line)


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
    steep = response_of_points_and_line().axes[0]
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


@pytest.mark.parametrize(('curves', 'message'), [
    ([], 'curves is empty'),
    ([ResponseCurve('a', [1.0], [1.0], style='bars')], "style of a is 'bars'"),
    ([ResponseCurve('a', [1.0, 2.0], [1.0])], r'a: .*\(2,\)'),
    ([ResponseCurve('a', [1.0], [1.0], [1.0, 2.0])], 'a: confidence_radius'),
])
def test_curves_that_cannot_be_drawn_are_refused_by_name(curves, message):
    with pytest.raises(ValueError, match=message):
        response_figure(curves, title='')


def test_a_single_point_can_be_drawn():
    figure = response_figure([ResponseCurve('a', [100.0], [0j + 1.0])], title='')
    assert png(figure).startswith(b'\x89PNG')
