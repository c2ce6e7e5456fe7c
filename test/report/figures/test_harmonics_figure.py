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

from piezo_ros.report.figures.export import png
from piezo_ros.report.figures.harmonics_figure import HarmonicsCurve, harmonics_figure


def harmonics_curve(chosen=9):
    m = np.arange(1, 20, 2)
    return HarmonicsCurve('2.5 µm, 300 Hz', m, 5.0 / m, np.where(m % 3, 5.1 / m, np.nan), chosen)


def test_the_same_curve_gives_the_same_picture(assert_reproducible):
    assert_reproducible(lambda: harmonics_figure([harmonics_curve()]))


def test_the_chosen_number_of_harmonics_is_ringed_where_it_is_predicted():
    panel = harmonics_figure([harmonics_curve(chosen=5)]).axes[0]
    ring = panel.get_lines()[-1]
    assert (*ring.get_xdata(), *ring.get_ydata()) == (5, 1.0)
    assert panel.get_title(loc='right') == 'm = 5'


@pytest.mark.parametrize(('curves', 'message'), [
    ([], 'curves is empty'),
    ([harmonics_curve(chosen=4)], 'chosen is 4'),
])
def test_curves_that_cannot_be_drawn_are_refused(curves, message):
    with pytest.raises(ValueError, match=message):
        harmonics_figure(curves)


def test_a_single_number_of_harmonics_can_be_drawn():
    figure = harmonics_figure([HarmonicsCurve('a', [1], [2.0], [float('nan')], 1)])
    assert png(figure).startswith(b'\x89PNG')
