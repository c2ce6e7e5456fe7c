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

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.identification.prediction.tracking import predict_tracking
from piezo_ros.model import DynamicsParameters, LinearDynamics, ParameterError, RigParameters

# Linear but for the hysteresis, which the compensator cancels. The feedforward inverts another
# model.
OTHER = DynamicsParameters(damping_ratio_1=0.5, time_constant_s=1.5e-4)
LINEAR_RIG = RigParameters(
    order='lumped', noise_rms_um=0.0, dac_bits=0, adc_bits=0, voltage_minimum_v=-100.0,
    voltage_maximum_v=100.0, adc_span_v=1000.0).replaced(**OTHER.to_mapping())


@pytest.mark.parametrize('scheme', ['ff', 'fbff', 'fb', 'open_loop'])
@pytest.mark.parametrize(('waveform', 'harmonics'), [
    ('triangle', 9), ('triangle', 1), ('triangle', 0), ('sine', 1)])
def test_the_spectra_foresee_what_a_linear_rig_does(scheme, waveform, harmonics):
    trajectory = TrajectoryParameters(
        waveform=waveform, frequency_hz=500.0, harmonics=harmonics, periods=20.0)
    law = ControllerParameters(scheme=scheme, measurement_delay_samples=2)
    spectral = predict_tracking(LinearDynamics(OTHER), trajectory, law)
    simulated = predict_tracking(LINEAR_RIG, trajectory, law)
    assert spectral.nrmse_percent == pytest.approx(simulated.nrmse_percent, rel=2e-3)
    assert not simulated.is_limited


@pytest.mark.parametrize('scheme', ['ff', 'fbff', 'fb', 'open_loop'])
@pytest.mark.parametrize('values', [
    {'offset_um': 2.0}, {'waveform': 'sawtooth', 'offset_um': -1.0, 'harmonics': 12},
    {'turn_fraction': 0.3, 'harmonics': 15},
    {'waveform': 'staircase', 'stairs': 2, 'turn_fraction': 1.0, 'harmonics': 25},
    {'waveform': 'lissajous', 'axis': 2, 'lissajous_cycles': (1.0, 3.0)}])
def test_the_spectra_foresee_other_waveforms_with_their_offset(scheme, values):
    trajectory = TrajectoryParameters(frequency_hz=200.0, periods=30.0, **values)
    # The dc gain is another one too, as only that shows in an offset.
    true = OTHER.replaced(gain_k_rad3_per_s3=0.97 * OTHER.gain_k_rad3_per_s3)
    law = ControllerParameters(scheme=scheme, measurement_delay_samples=2)
    spectral = predict_tracking(LinearDynamics(true), trajectory, law)
    simulated = predict_tracking(LINEAR_RIG.replaced(**true.to_mapping()), trajectory, law)
    assert spectral.nrmse_percent == pytest.approx(simulated.nrmse_percent, rel=3e-3)


def test_uncertainty_enters_as_in_14_and_15():
    trajectory = TrajectoryParameters(frequency_hz=400.0)
    model = LinearDynamics()

    def uncertainty(frequency_hz):
        return 0.05 + frequency_hz / 1e5

    ff, fbff = (
        predict_tracking(
            model, trajectory, ControllerParameters(scheme=scheme), uncertainty=uncertainty)
        for scheme in ('ff', 'fbff'))
    inside = ff.frequency_hz < 10 * 400.0
    delta = uncertainty(ff.frequency_hz)
    # The output is nearly the reference, so that E_ff = Y_d Delta …
    np.testing.assert_allclose(
        ff.uncertain_error_um[inside], np.abs(ff.reference_um * delta)[inside], rtol=0.1)
    # … and there is no output beyond harmonic m, where the command is zero.
    assert not ff.uncertain_error_um[~inside].any()
    # E_fbff = E_ff S but for the small known error: feedback helps below 415 Hz and harms above.
    ratio = fbff.uncertain_error_um[inside] / ff.uncertain_error_um[inside]
    assert ratio[0] < 1.0 < ratio[1]
    assert ff.nrmse_percent**2 == pytest.approx(
        predict_tracking(
            model, trajectory, ControllerParameters(scheme='ff')).nrmse_percent**2
        + ff.uncertainty_percent**2)


def test_nine_harmonics_leave_the_published_share_of_a_triangle():
    spectral = predict_tracking(
        LinearDynamics(), TrajectoryParameters(), ControllerParameters(scheme='ff'))
    assert spectral.truncation_percent == pytest.approx(0.37, abs=0.01)


def test_a_run_beyond_slew_limit_or_rails_says_so():
    law = ControllerParameters(scheme='ff')
    scan = TrajectoryParameters(amplitude_um=2.5, frequency_hz=800.0).replaced(
        **OTHER.to_mapping())
    free = predict_tracking(LINEAR_RIG, scan, law)
    slow = LINEAR_RIG.replaced(slew_limit_v_per_s=0.9 * free.slew_v_per_s)
    low = LINEAR_RIG.replaced(voltage_minimum_v=5.0 + 0.9 * free.voltage_minimum_v)
    high = LINEAR_RIG.replaced(voltage_maximum_v=5.0 + 0.9 * free.voltage_maximum_v)
    just = LINEAR_RIG.replaced(slew_limit_v_per_s=1.001 * free.slew_v_per_s)
    limited = [predict_tracking(rig, scan, law) for rig in (slow, low, high, just)]
    assert [one.slew_limited for one in limited] == [True, False, False, False]
    assert [one.rail_limited for one in limited] == [False, True, True, False]
    assert all(one.nrmse_percent > free.nrmse_percent for one in limited[:3])


def test_a_waveform_without_fourier_series_is_refused():
    with pytest.raises(ParameterError, match='decreasing_triangle'):
        predict_tracking(
            LinearDynamics(), TrajectoryParameters(waveform='decreasing_triangle', harmonics=0),
            ControllerParameters())


def test_more_periods_than_the_run_has_cannot_be_scored():
    with pytest.raises(ValueError, match='score_periods is 4.0, allowed is above 0 … 3.0'):
        predict_tracking(
            LINEAR_RIG, TrajectoryParameters(periods=3.0), ControllerParameters())
