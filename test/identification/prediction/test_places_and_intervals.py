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


"""Predictions with the place of the hysteresis among the poles, and with the errors of models."""

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.experiment.plan.automatic import known_rig
from piezo_ros.identification.prediction.accuracy import ModelAccuracy
from piezo_ros.identification.prediction.operating_points import predict_operating_point
from piezo_ros.identification.prediction.placement import likely_place, placements
from piezo_ros.identification.prediction.tracking import predict_tracking
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    MaxwellResistiveCapacitor,
    RigParameters,
)

TS = 1e-4
HYSTERESIS = HysteresisParameters(
    kappa_um_per_v=(25.0, 60.0, 110.0, 160.0, 200.0, 10.0),
    saturation_v=(0.02, 0.06, 0.12, 0.2, 0.25))
SHEET = {
    'travel_um': 100.0, 'operating_point_um': 50.0, 'voltage_minimum_v': 0.0,
    'slew_limit_v_per_s': 1500.0, 'sensor_scale_um_per_v': 10.0, 'noise_rms_um': 0.005}
# The amplifier is the faster pair of the slow stage; a lag before its only mode of the other.
PAIRS = {
    'dynamics': 'sections', 'pole_rates_rad_per_s': (3125.0,),
    'pole_frequencies_rad_per_s': (5027.0, 1885.0), 'pole_damping_ratios': (0.8, 0.05)}
LAG = {
    'dynamics': 'sections', 'pole_rates_rad_per_s': (2.0 * np.pi * 400.0,),
    'pole_frequencies_rad_per_s': (2.0 * np.pi * 1200.0,), 'pole_damping_ratios': (0.03,),
    'rates_before_hysteresis': 1, 'pairs_before_hysteresis': 0}
GAINS = ControllerParameters(
    proportional_gain=1e-4, integral_gain_per_s=150.0, command_minimum_um=-50.0,
    command_maximum_um=50.0)


def rig_of(dynamics, **others):
    return RigParameters.from_mapping({
        **SHEET, **HYSTERESIS.to_mapping(), **dynamics, **others})


def scan_of(dynamics, **others):
    return TrajectoryParameters.from_mapping({
        'amplitude_um': 12.0, 'frequency_hz': 110.0, 'harmonics': 5, 'sample_period_s': TS,
        'model_response': 'sampled', **dynamics, **others})


def measured_percent(rig, scan, law, compensator=HYSTERESIS):
    """NRMSE of the last four periods of a run on the true rig."""
    run = simulate(rig, compensator, law, scan)
    count = round(4.0 / (scan.frequency_hz * TS))
    error = run.reference_um[-count:] - run.displacement_um[:-1][-count:]
    return 100.0 * np.sqrt(np.mean(error**2)) / np.ptp(run.reference_um[-count:])


@pytest.mark.parametrize('dynamics', [PAIRS, LAG])
@pytest.mark.parametrize('cell', [(12.0, 57.0), (21.0, 57.0), (12.0, 110.0)])
def test_d1_the_prediction_has_the_identified_poles_before_the_hysteresis(dynamics, cell):
    scan = scan_of(dynamics, amplitude_um=cell[0], frequency_hz=cell[1])
    known = known_rig({}, RigParameters.from_mapping(SHEET), HYSTERESIS, scan)
    for scheme in ('ff', 'fbff'):
        law = GAINS.replaced(scheme=scheme)
        predicted = predict_tracking(known, scan, law, compensator=HYSTERESIS).nrmse_percent
        assert predicted == pytest.approx(
            measured_percent(rig_of(dynamics, seed=9), scan, law), rel=0.05)


def test_d1_a_place_that_is_not_decided_is_told_with_all_it_may_be():
    swapped = {
        **PAIRS, 'pole_frequencies_rad_per_s': (1885.0, 5027.0), 'pole_damping_ratios': (0.05, 0.8),
        'hysteresis_place': 'undecided'}
    scan = scan_of(swapped, amplitude_um=12.0)
    known = known_rig({}, RigParameters.from_mapping(SHEET), HYSTERESIS, scan)
    accuracy = ModelAccuracy(hysteresis_rms_um=0.005, model_error=1e-3)
    point = predict_operating_point(
        known, scan, GAINS, harmonics_open=False, compensator=HYSTERESIS, accuracy=accuracy)
    for scheme, prediction in point.predictions.items():
        measured = measured_percent(rig_of(PAIRS), scan, GAINS.replaced(scheme=scheme))
        low, high = prediction.interval
        assert low <= measured <= high
        assert len(prediction.by_place_percent) == len(placements(known)) == 8
    # The wrong place alone is wrong by more than a factor.
    assert point.predictions['ff'].simulated_nrmse_percent > 1.5 * measured_percent(
        rig_of(PAIRS), scan, GAINS.replaced(scheme='ff'))
    assert point.depends_on_place == (len(set(point.schemes_by_place)) > 1)
    assert point.depends_on_place == ('is not decided' in point.reason)
    assert point.record()['depends_on_place'] == point.depends_on_place


def test_d1_where_nothing_is_told_the_well_damped_pair_is_the_likely_amplifier():
    swapped = DynamicsParameters(
        natural_frequency_1_rad_per_s=1885.0, damping_ratio_1=0.05,
        natural_frequency_2_rad_per_s=5027.0, damping_ratio_2=0.8)
    likely = likely_place(swapped)
    assert (likely.natural_frequency_1_rad_per_s, likely.damping_ratio_1) == (5027.0, 0.8)
    assert (likely.pairs_before_hysteresis, likely.hysteresis_place) == (1, 'undecided')
    assert likely_place(DynamicsParameters()).replaced(
        hysteresis_place='known') == DynamicsParameters()
    mode = DynamicsParameters(
        dynamics='sections', pole_frequencies_rad_per_s=[5e3], pole_damping_ratios=[0.02])
    assert likely_place(mode).pairs_before_hysteresis == 0


def test_d1_a_rig_that_is_known_as_lumped_is_lumped():
    scan, sheet = scan_of(PAIRS), RigParameters.from_mapping(SHEET)
    assert known_rig({}, sheet, HYSTERESIS, scan).order == 'physical'
    assert known_rig({'plant': {'order': 'lumped'}}, sheet, HYSTERESIS, scan).order == 'lumped'


def test_places_of_zeros_before_the_hysteresis_are_left_out():
    table_2 = DynamicsParameters(hysteresis_place='undecided')
    places = placements(table_2)
    assert places[0] == table_2
    assert {each.order_before for each in places} == {0, 1, 2, 3}
    swapped = [each for each in places if each.damping_ratio_1 == table_2.damping_ratio_2]
    assert {each.rates_before_hysteresis for each in swapped} == {0, 1}
    for each in places:
        np.testing.assert_allclose(each.dc_gain, table_2.dc_gain)
    assert placements(DynamicsParameters()) == (DynamicsParameters(),)


def accuracy_of(true, identified, levels):
    """Return what identification would tell: the residual of loops of several amplitudes."""
    residuals, spans = [], []
    for level in levels:
        voltage = level * np.sin(np.linspace(0.0, 6.0 * np.pi, 6000))
        one, other = (
            MaxwellResistiveCapacitor(each.kappa_um_per_v, each.saturation_v).forward(voltage)[0]
            for each in (true, identified))
        residuals.append(np.std((one - other)[2000:]))
        spans.append(np.ptp(one[2000:]))
    return ModelAccuracy(
        hysteresis_rms_um=float(np.sqrt(np.mean(np.square(residuals)))), noise_rms_um=0.0,
        level_v=tuple(levels),
        level_percent=tuple(100.0 * np.array(residuals) / np.array(spans)), model_error=1e-3)


@pytest.mark.parametrize('seed', [3, pytest.param(4, marks=pytest.mark.slow)])
def test_d9_the_residual_of_the_hysteresis_is_part_of_the_prediction(seed):
    """The identified hysteresis has the right elements of another compliance."""
    rng = np.random.default_rng(seed)
    kappa = np.array(HYSTERESIS.kappa_um_per_v)
    true = HYSTERESIS.replaced(kappa_um_per_v=tuple(kappa * (1.0 + rng.normal(0, 0.1, 6))))
    accuracy = accuracy_of(true, HYSTERESIS, [0.5, 1.0, 2.0, 3.0, 4.0])
    sheet, rig = RigParameters.from_mapping(SHEET), rig_of(PAIRS, **true.to_mapping())
    ratios, inside = [], []
    for amplitude_um in (4.0, 12.0, 25.0):
        scan = scan_of(PAIRS, amplitude_um=amplitude_um, frequency_hz=20.0, harmonics=9)
        known = known_rig({}, sheet, HYSTERESIS, scan)
        for scheme in ('ff', 'fbff', 'fb'):
            law = GAINS.replaced(scheme=scheme)
            prediction = predict_tracking(
                known, scan, law, compensator=HYSTERESIS, accuracy=accuracy)
            measured = measured_percent(rig, scan, law)
            ratios.append(measured / prediction.nrmse_percent)
            low, high = prediction.interval
            inside.append(low < measured < high)
            assert prediction.unknown == ()
    ratios = np.array(ratios)
    assert np.count_nonzero((ratios > 0.6) & (ratios < 1.7)) >= 8, ratios
    assert ratios.min() > 0.5
    assert ratios.max() < 2.0
    assert sum(inside) >= 8


def test_d9_a_part_that_is_not_known_leaves_the_interval_open():
    scan = scan_of(PAIRS)
    known = known_rig({}, RigParameters.from_mapping(SHEET), HYSTERESIS, scan)
    blind = predict_tracking(known, scan, GAINS.replaced(scheme='ff'), compensator=HYSTERESIS)
    assert blind.interval.high_percent is None
    assert blind.unknown == ('hysteresis residual', 'W(s)', 'error of the dynamics')
    assert blind.record()['high_percent'] is None
    bounded = predict_tracking(
        known, scan, GAINS.replaced(scheme='ff'), compensator=HYSTERESIS,
        uncertainty=lambda f: 0.05 + 0.0 * f)
    assert bounded.unknown == ('hysteresis residual',)
    assert bounded.uncertainty_percent > 1.0
    # Beyond the band of the model its error is 100 %.
    narrow = predict_tracking(
        known, scan, GAINS.replaced(scheme='ff'), compensator=HYSTERESIS,
        accuracy=ModelAccuracy(model_error=0.001, usable_to_hz=300.0))
    assert narrow.model_percent > 1.0
