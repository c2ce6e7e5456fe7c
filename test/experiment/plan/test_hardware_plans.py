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

"""Plans with a device: what they take, what they refuse by name, what they ask of an amplifier."""

import json

import pytest

from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.device_limits import check_device_plan
from piezo_ros.experiment.plan.hardware_entry import stand_in
from piezo_ros.experiment.plan.rig_limits import check_plan
from piezo_ros.live.run_parameters import run_parameters
from piezo_ros.parameters.errors import CampaignError, PlanError
from piezo_ros.parameters.node_parameters import HARDWARE_PLANT, parameter_names

# The E-625 of the paper's rig, with a P-753 of 0.26 uF by its data sheet.
E625 = {'load_capacitance_f': 0.4417e-6, 'peak_current_a': 0.12, 'average_current_a': 0.06}
KNOWN = """
/**/compensator: {ros__parameters: {kappa_um_per_v: [1.0, 1.0], saturation_v: [0.5]}}
/**/trajectory: {ros__parameters: {delay_s: 1.0e-5}}
"""


@pytest.fixture
def plan(tmp_path):
    def write(run, *, known=False, **top):
        path = tmp_path / 'plan.yaml'
        (tmp_path / 'known.yaml').write_text(KNOWN)
        top = {
            'format_version': 1, 'score_periods': 1, **top,
            'runs': [{
                **({} if 'output' in run else {'scheme': 'ff'}), 'periods': 3, 'ramp_periods': 1,
                **run}]}
        if known:
            top['known_rig_files'] = ['known.yaml']
        path.write_text(json.dumps(top))  # which is YAML
        return read_plan(path)

    return write


def test_a_device_has_its_own_parameters_beside_those_of_a_data_sheet(plan):
    run = plan({'plant': {'device': 'ni', 'travel_um': 20.0, 'prefill_samples': 5}}).runs[0]
    assert run.hardware.prefill_samples == 5
    assert run.hardware.travel_um == run.plant.travel_um == 20.0
    assert run.hardware.demagnetise


def test_a_simulated_stage_is_new_and_is_not_demagnetised_unless_that_is_asked_for(plan):
    assert not plan({'plant': {'device': 'simulated'}}).runs[0].hardware.demagnetise
    asked = {'device': 'simulated', 'demagnetise': True}
    assert plan({'plant': asked}).runs[0].hardware.demagnetise


def test_what_only_a_simulated_rig_has_is_told_to_be_ignored(plan):
    notes = plan({'plant': {'device': 'ni', 'noise_rms_um': 0.0}}).notes
    assert any('noise_rms_um of plant is ignored' in note for note in notes)
    assert not plan({'plant': {'device': 'simulated', 'noise_rms_um': 0.0}}).notes


@pytest.mark.parametrize(('run', 'words'), [
    ({'plant': {'device': 'ni', 'prefil_samples': 1}}, "unknown parameter 'prefil_samples'"),
    ({'plant': {'device': 'oscilloscope'}}, "device is 'oscilloscope', allowed are"),
    ({'plant': {'prefill_samples': 1}}, "unknown parameter 'prefill_samples' of plant"),
    ({'scheme': 'fbff', 'plant': {'device': 'ni'}}, 'scheme is fbff, which needs each reading'),
    ({'scheme': 'fb', 'plant': {'device': 'simulated'}}, 'scheme is fb, which needs each reading'),
    ({'plant': {'device': 'ni'}, 'changes': [{'at_sample': 100, 'scheme': 'fbff'}]},
     'scheme is fbff, which needs each reading'),
    ({'plant': {'device': 'ni', 'timing': 'on_demand'}}, 'sample_period_s is 1e-05 s; timing'),
    ({'plant': {'device': 'ni', 'safe_slew_v_per_s': 1.0}}, 'safe_slew_v_per_s is 1 V/s'),
    ({'plant': {'device': 'ni', 'input_channel': 'Dev1/ai0:3'}}, "input_channel is 'Dev1/ai0:3'"),
    ({'plant': {'device': 'gcs', 'address': 'nowhere'}}, "address is 'nowhere'"),
    ({'plant': {'device': 'simulated', 'simulated_rig_file': 'x.yaml'}}, 'simulated_rig_file'),
    ({'plant': {'device': 'ni', 'travel_um': 3.0, 'operating_point_um': 6.0}},
     'operating_point_um is 6.0'),
])
def test_what_a_device_cannot_do_is_refused_by_name(plan, run, words):
    with pytest.raises(PlanError) as refused:
        plan(run)
    assert words in str(refused.value)


def test_on_demand_takes_feedback(plan):
    run = plan(
        {'scheme': 'fbff', 'frequency_hz': 2.0, 'plant': {'device': 'ni', 'timing': 'on_demand'}},
        sample_period_s=1e-3).runs[0]
    assert run.hardware.is_on_demand


def test_the_limits_of_the_amplifier_are_those_of_its_current(plan):
    (fast,) = check_device_plan(plan({
        'amplitude_um': 2.5, 'frequency_hz': 800.0, 'harmonics': 9,
        'plant': {'device': 'ni', **E625}}))
    assert fast.beyond
    assert 'peak current 281 mA asked, 120 mA allowed' in fast.beyond_text
    (demo,) = check_device_plan(plan({
        'amplitude_um': 1.0, 'frequency_hz': 300.0, 'harmonics': 9,
        'plant': {'device': 'ni', **E625}}))
    assert not demo.beyond
    assert 'peak current 15 mA asked, 120 mA allowed' in demo.text
    assert 'rate 100000 Hz, whole run prefilled' in demo.text


def test_a_feedforward_that_starts_at_once_begins_with_a_step_that_is_refused(plan):
    (demand,) = check_device_plan(plan({
        'ramp_periods': 0, 'plant': {'device': 'ni', 'slew_limit_v_per_s': 18e3}}))
    assert demand.first_step_v > 0.3
    assert 'sample 0: slew 40' in demand.beyond_text
    assert '18 V/ms allowed' in demand.beyond_text


def test_a_demagnetisation_beyond_the_current_is_refused_too(plan):
    (demand,) = check_device_plan(plan({'plant': {
        'device': 'ni', **E625, 'average_current_a': 1e-3, 'safe_slew_v_per_s': 5000.0}}))
    assert 'average current of the demagnetisation' in demand.beyond_text


def test_what_is_not_known_is_told(plan):
    (demand,) = check_device_plan(plan({'plant': {'device': 'ni'}}))
    assert 'current: not checked' in demand.text
    assert 'travel: not checked' in demand.text
    assert check_plan(plan({'plant': {'device': 'ni'}})) == []
    assert len(check_plan(plan({'plant': {'device': 'ni'}}, known=True))) == 1


def test_a_real_stage_is_simulated_only_by_known_models(plan, tmp_path):
    unknown = plan({'plant': {'device': 'ni'}})
    with pytest.raises(PlanError, match='no section for compensator, trajectory'):
        stand_in(unknown.runs[0], unknown.known)
    with pytest.raises(CampaignError, match='device ni'):
        simulate_run(unknown.runs[0], tmp_path / 'bag')
    known = plan({'plant': {'device': 'ni', 'travel_um': 15.0}}, known=True)
    rig = stand_in(known.runs[0], known.known)
    assert rig.hardware is None
    assert rig.plant.saturation_v == (0.5,)
    assert (rig.plant.delay_s, rig.plant.travel_um) == (1e-5, 15.0)


@pytest.mark.parametrize('top', [
    {'sweep': {'runs': 2, 'draw': {'plant.gain_mismatch': {'uniform': [0, 0.1]}}}}])
def test_a_sweep_is_of_the_simulated_rig(plan, top):
    with pytest.raises(PlanError, match='must have no device'):
        plan({'plant': {'device': 'simulated'}}, **top)


@pytest.mark.parametrize('bare', [False, True])
def test_the_nodes_are_told_to_send_far_enough_ahead(plan, tmp_path, bare):
    excitation = {'output': 'voltage', 'amplitude_v': 1.0} if bare else {}
    run = plan({'plant': {'device': 'simulated'}, **excitation}).runs[0]
    file = tmp_path / 'parameters.yaml'
    sections = run_parameters(run, tmp_path / 'bag', record=True, autostart=True, file=file)
    plant = sections['plant']
    assert set(plant) <= set(parameter_names(HARDWARE_PLANT))
    assert plant['simulated_rig_file'] == str(tmp_path / 'parameters.rig.yaml')
    ahead = plant['demand_lookahead_samples'] if bare else (
        sections['controller']['lookahead_samples'])
    assert ahead > run.trajectory.samples
    if not bare:
        assert sections['controller']['max_buffer_samples'] >= ahead
