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
from piezo_ros.report.figures.uncertainty_figure import BoundCurve, uncertainty_figure

FREQUENCY_HZ = np.geomspace(10.0, 3000.0, 40)
RESPONSE = 0.9 / (1.0 + 1j * FREQUENCY_HZ / 300.0)**3


def dense_uncertainty():
    return uncertainty_figure(
        np.tile(FREQUENCY_HZ, 100), 0.1 * np.tile(RESPONSE, 100),
        [BoundCurve('W', FREQUENCY_HZ, np.full(40, 0.2))])


def test_the_same_points_give_the_same_picture(assert_reproducible):
    assert_reproducible(dense_uncertainty)


def test_what_is_rasterised_is_the_same_as_png_too():
    assert png(dense_uncertainty()) == png(dense_uncertainty())


def test_many_points_become_a_picture_inside_the_drawing_and_few_do_not():
    def images(points):
        figure = uncertainty_figure(
            np.geomspace(10.0, 1e3, points), np.full(points, 0.1), [])
        return svg(figure, 'a').count('<image ')

    assert images(100) == 0
    assert images(5000) == 1


def test_uncertainty_is_drawn_by_its_magnitude():
    figure = uncertainty_figure([10.0, 20.0], [0.3 + 0.4j, -0.1], [])
    assert figure.axes[0].get_lines()[0].get_ydata() == pytest.approx([0.5, 0.1])


def test_lists_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match='equally long'):
        uncertainty_figure([1.0], [], [])


def test_lists_can_be_drawn():
    assert png(uncertainty_figure([100.0, 200.0], [0.0, 0.1], [])).startswith(b'\x89PNG')
