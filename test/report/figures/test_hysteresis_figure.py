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

from piezo_ros.report.figures.hysteresis_figure import (
    Loop,
    hysteresis_figure,
    loops_figure,
    straight_line_deviation,
)


def loop(width=0.2, label='voltage (V)'):
    phase = np.linspace(0.0, 2.0 * np.pi, 20001)
    return Loop(3.0 * np.sin(phase), 2.7 * np.sin(phase - width), label, 11.9, 12.5)


def test_the_same_loops_give_the_same_picture(assert_reproducible):
    assert_reproducible(lambda: loops_figure(loop(), loop(0.001, 'command (µm)')))


def test_a_loop_stands_beside_its_published_nonlinearity(words):
    text = words(loops_figure(loop(), loop(0.001, 'command (µm)')))
    for number in ('11.90', '12.50', '11.84', '13.14', '0.40', '0.38'):
        assert f'{number} %' in text


def test_deviation_from_a_straight_line_leaves_out_slope_and_offset():
    x = np.linspace(-1.0, 1.0, 101)
    assert straight_line_deviation(x, 3.0 * x + 5.0) == pytest.approx(np.zeros(101), abs=1e-12)
    bent = straight_line_deviation(x, x**2 + x)
    assert bent == pytest.approx(x**2 - np.mean(x**2), abs=1e-12)


def test_a_long_record_is_thinned_and_keeps_its_extremes():
    top = loops_figure(loop(), loop(0.001, 'command (µm)')).axes[0]
    (line,) = top.get_lines()
    assert line.get_xdata().size <= 2000
    assert np.ptp(line.get_xdata()) == pytest.approx(6.0, rel=1e-4)


def test_hysteresis_wraps_after_four_panels(scored_runs):
    panels = hysteresis_figure([scored_runs[0]] * 5).axes
    assert [panel.get_visible() for panel in panels] == [True] * 5 + [False] * 3
