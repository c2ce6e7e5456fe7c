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

import base64
import json

import numpy as np
import pytest

from piezo_ros.report.page.chart import chart_json
from piezo_ros.report.page.curve_panel import Curve, CurvePanel, curve_panel_content

AROUND = np.linspace(0.0, 2.0 * np.pi, 100)


def values(text):
    return np.frombuffer(base64.b64decode(text), '<f4')


def circle(**settings):
    return Curve('circle', np.cos(AROUND), np.sin(AROUND), **settings)


def test_points_keep_their_order_and_what_runs_along_them():
    panel = CurvePanel(
        'x (V)', 'y (µm)', [circle(along=AROUND)], along_label='angle', has_equal_scales=True)
    (chart,) = json.loads(chart_json('a', 'A circle.', [panel]))['panels']
    assert (chart['kind'], chart['along_label'], chart['equal']) == ('curves', 'angle', True)
    (curve,) = chart['curves']
    np.testing.assert_allclose(values(curve['x']), np.cos(AROUND), atol=1e-7)
    np.testing.assert_allclose(values(curve['along'][0]), AROUND, rtol=1e-6)


def test_the_range_holds_every_finite_point_unless_it_is_given():
    points = Curve('points', [0.0, np.nan, 10.0], [1.0, 2.0, np.inf], style='none', marker='open')
    found = curve_panel_content(CurvePanel('x', 'y', [points], y_range=(-2.0, 2.0)))
    assert found['x_range'] == pytest.approx([-0.5, 10.5])
    assert found['y_range'] == [-2.0, 2.0]
    assert np.isnan(values(found['curves'][0]['x'])[1])
    nothing = Curve('gap', [np.nan], [np.nan])
    assert curve_panel_content(CurvePanel('x', 'y', [nothing]))['x_range'] == [-1.0, 1.0]


def test_a_long_curve_is_thinned():
    long = Curve('long', np.arange(9001.0), np.arange(9001.0), along=np.arange(9001.0))
    (curve,) = curve_panel_content(CurvePanel('x', 'y', [long]))['curves']
    assert values(curve['x']).size == values(curve['along'][0]).size == 3001


@pytest.mark.parametrize(('curve', 'complaint'), [
    (circle(style='wavy'), "of curve 'circle' are 'wavy' and ''"),
    (circle(marker='star'), "are 'solid' and 'star'"),
    (circle(along=[1.0]), r"along of curve 'circle' have the shapes \(100,\), \(100,\), \(1,\)"),
    (Curve('none', [], []), r"curve 'none' have the shapes \(0,\)")])
def test_what_cannot_be_drawn_is_named(curve, complaint):
    with pytest.raises(ValueError, match=complaint):
        curve_panel_content(CurvePanel('x', 'y', [curve]))
