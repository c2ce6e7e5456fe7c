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

import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.operating_points import choose_harmonics
from piezo_ros.identification.prediction.tracking import predict_tracking
from piezo_ros.model import DynamicsParameters, ParameterError, RigParameters

# The identified model differs slightly from the rig.
DYNAMICS = DynamicsParameters(damping_ratio_1=0.55, time_constant_s=1.5e-4)
KNOWN = RigParameters(slew_limit_v_per_s=18200.0, noise_rms_um=0.0).replaced(
    **DYNAMICS.to_mapping())
RIG = KNOWN.replaced(
    noise_rms_um=1e-3, gain_mismatch=-0.002, natural_frequency_1_mismatch=0.005,
    damping_ratio_1_mismatch=-0.005, natural_frequency_2_mismatch=0.01)
FF = ControllerParameters(scheme='ff')


def scan(amplitude_um, frequency_hz, **others):
    return TrajectoryParameters(
        amplitude_um=amplitude_um, frequency_hz=frequency_hz, **others).replaced(
            **DYNAMICS.to_mapping())


def measured_percent(trajectory, harmonics, controller=FF):
    return predict_tracking(
        RIG, trajectory.replaced(harmonics=harmonics), controller).nrmse_percent


def test_where_the_amplifier_follows_many_harmonics_win():
    choice = choose_harmonics(KNOWN, scan(1.0, 300.0), FF)
    assert choice.harmonics > 9
    assert not choice.predictions[4].is_limited
    assert measured_percent(scan(1.0, 300.0), choice.harmonics) < 0.8 * measured_percent(
        scan(1.0, 300.0), 9)


@pytest.mark.parametrize('scheme', ['ff', 'fbff'])
def test_where_the_amplifier_does_not_follow_fewer_win(scheme):
    fast, law = scan(2.5, 800.0), ControllerParameters(scheme=scheme)
    choice = choose_harmonics(KNOWN, fast, law)
    assert choice.harmonics < 9
    assert choice.predicted_nrmse_percent[9] > 2.0 * choice.chosen.nrmse_percent
    assert choice.predictions[4].harmonics == 9
    assert choice.predictions[4].slew_limited
    assert measured_percent(fast, choice.harmonics, law) < 0.5 * measured_percent(fast, 9, law)
    # The same scan with an amplifier without slew limit.
    free = choose_harmonics(KNOWN.replaced(slew_limit_v_per_s=0.0), fast, law)
    assert free.harmonics > choice.harmonics
    assert free.chosen.nrmse_percent < choice.chosen.nrmse_percent


def test_the_prediction_is_what_comes_out_on_the_rig():
    for amplitude_um, frequency_hz in ((0.5, 400.0), (2.0, 700.0)):
        trajectory = scan(amplitude_um, frequency_hz)
        choice = choose_harmonics(KNOWN, trajectory, FF, highest=15)
        best = min(measured_percent(trajectory, m) for m in range(1, 16, 2))
        assert measured_percent(trajectory, choice.harmonics) < 1.25 * best


def test_harmonics_that_the_model_does_not_know_are_left_out():
    def uncertainty(frequency_hz):
        return 0.02 + 3.0 * (frequency_hz > 3000.0)  # nothing is known beyond 3 kHz

    known = KNOWN.replaced(slew_limit_v_per_s=0.0)
    sure = choose_harmonics(known, scan(1.0, 400.0), FF)
    unsure = choose_harmonics(known, scan(1.0, 400.0), FF, uncertainty=uncertainty)
    assert unsure.harmonics == 7
    assert sure.harmonics > 7
    share = {one.harmonics: one.uncertainty_percent for one in unsure.predictions}
    assert share[9] > 2.0 * share[7]


def test_every_odd_number_below_the_nyquist_frequency_is_tried():
    choice = choose_harmonics(KNOWN, scan(0.1, 7000.0, harmonics=1), FF)
    assert list(choice.predicted_nrmse_percent) == [1, 3, 5, 7]
    assert len(choose_harmonics(KNOWN, scan(1.0, 300.0), FF, highest=6).predictions) == 3
    records = [one.record() for one in choice.predictions]
    assert [record['harmonics'] for record in records] == [1, 3, 5, 7]


def test_a_sine_has_one_harmonic():
    choice = choose_harmonics(KNOWN, scan(1.0, 300.0, waveform='sine'), FF)
    assert choice.harmonics == 1
    assert len(choice.predictions) == 1


def test_a_scheme_without_feedforward_needs_no_harmonics():
    with pytest.raises(ParameterError, match="scheme is 'fb', which has no feedforward"):
        choose_harmonics(KNOWN, scan(1.0, 300.0), ControllerParameters(scheme='fb'))


def test_no_harmonics_cannot_be_asked_for():
    with pytest.raises(ValueError, match='highest is 0'):
        choose_harmonics(KNOWN, scan(1.0, 300.0), FF, highest=0)
