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

import math
from types import SimpleNamespace

import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification import (
    feedback_table,
    predict_operating_point,
    predict_operating_points,
)
from piezo_ros.identification.prediction.operating_points import OperatingPoint
from piezo_ros.identification.prediction.tracking import predict_tracking
from piezo_ros.model import RigParameters

RIG = RigParameters(slew_limit_v_per_s=18200.0, gain_mismatch=-0.05, time_constant_mismatch=-0.07)
LAW = ControllerParameters()
SCAN = TrajectoryParameters()
CELLS = [(a, f) for a in (0.5, 2.5) for f in (300.0, 500.0, 700.0)]


@pytest.fixture(scope='module')
def points():
    return predict_operating_points(RIG, SCAN, LAW, CELLS, harmonics_open=False)


def test_every_cell_is_predicted_in_the_given_order(points):
    assert [(point.amplitude_um, point.frequency_hz) for point in points] == CELLS
    assert {point.scheme for point in points} == {'ff', 'fbff'}
    for point in points:
        assert point.harmonics == {'ff': 9, 'fbff': 9, 'fb': 0}
        assert point.choices == {}


def test_the_table_tells_auto_the_better_one_of_ff_and_fbff(points):
    table = feedback_table(points)
    assert table.amplitude_um == (0.5, 2.5)
    for point in points:
        auto = LAW.replaced(
            scheme='auto', feedback_acceptable_amplitude_um=table.amplitude_um,
            feedback_acceptable_frequency_hz=table.frequency_hz,
            scan_amplitude_um=point.amplitude_um, scan_frequency_hz=point.frequency_hz)
        predicted = point.predicted_nrmse_percent
        assert auto.concrete_scheme == min(('ff', 'fbff'), key=lambda name: predicted[name])


def test_the_amplifiers_limits_bring_the_frequency_down_at_large_amplitudes(points):
    small_hz, large_hz = feedback_table(points).frequency_hz
    free = predict_operating_points(
        RIG.replaced(slew_limit_v_per_s=0.0), SCAN, LAW, CELLS, harmonics_open=False)
    assert large_hz < small_hz
    assert feedback_table(free).frequency_hz[1] > large_hz
    assert [point.limited['fbff'] for point in points] == [False] * 4 + [True] * 2
    assert not any(point.limited['fbff'] for point in free)


def test_with_harmonics_open_each_scheme_has_its_own_and_the_error_of_that_run():
    scan = SCAN.replaced(amplitude_um=2.5, frequency_hz=700.0)
    point = predict_operating_point(RIG, scan, LAW)
    assert set(point.choices) == {'ff', 'fbff'}
    for scheme, choice in point.choices.items():
        assert point.harmonics[scheme] == choice.harmonics
        run = predict_tracking(
            RIG, scan.replaced(harmonics=choice.harmonics), LAW.replaced(scheme=scheme))
        assert point.predicted_nrmse_percent[scheme] == pytest.approx(run.nrmse_percent)
        assert point.limited[scheme] == run.is_limited
    fixed = predict_operating_point(RIG, scan, LAW, harmonics_open=False)
    assert point.predicted_nrmse_percent['ff'] < fixed.predicted_nrmse_percent['ff']


def test_an_unstable_loop_leaves_feedforward_alone():
    wild = LAW.replaced(proportional_gain=5.0)
    points = predict_operating_points(RIG, SCAN, wild, CELLS, harmonics_open=False)
    assert {point.scheme for point in points} == {'ff'}
    assert feedback_table(points).frequency_hz == (0.0, 0.0)


def point(frequency_hz, ff, fbff):
    predictions = {
        name: SimpleNamespace(nrmse_percent=percent) for name, percent in (
            ('ff', ff), ('fbff', fbff))}
    return OperatingPoint(1.0, frequency_hz, predictions, {}, None)


@pytest.mark.parametrize(('fbff', 'below_hz'), [
    ((0.5, 0.5, 2.0), 350.0),
    ((2.0, 2.0, 2.0), 0.0),
    ((0.5, 0.5, 0.5), math.nextafter(400.0, math.inf)),
    # Of two crossings the one of less error; the lower one of equals.
    ((0.5, 2.0, 0.5), 250.0),
    ((0.5, 1.5, 0.4), math.nextafter(400.0, math.inf)),
    ((2.0, 0.4, 2.0), 356.94),
    ((3.0, 0.5, 2.0), 0.0),
])
def test_feedback_is_acceptable_up_to_where_it_stops_helping(fbff, below_hz):
    row = [point(f, 1.0, error) for f, error in zip((200.0, 300.0, 400.0), fbff, strict=True)]
    for order in (row, row[::-1]):
        assert feedback_table(order).frequency_hz == (pytest.approx(below_hz, rel=1e-4),)
    assert (feedback_table(row).frequency_hz[0] > 400.0) == (below_hz > 400.0)
