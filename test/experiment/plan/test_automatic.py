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

import json
import math

import numpy as np
import pytest
import yaml

from piezo_ros import paper
from piezo_ros.control import (
    ControllerParameters,
    TrajectoryParameters,
    simulate,
    simulate_bare,
)
from piezo_ros.control.waveform import excitation_of
from piezo_ros.experiment.plan import plan_run, read_plan
from piezo_ros.identification import (
    Amplifier,
    fit_dynamics,
    fit_hysteresis,
    frequency_response,
    merge,
)
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.report.metrics import nrmse, tail
from piezo_ros.study.table_4 import table_cells

MISMATCHES = [name for name in RigParameters().to_mapping() if name.endswith('_mismatch')]
TABLE = [
    {'amplitude_um': amplitude_um, 'frequency_hz': list(row)}
    for amplitude_um, row in paper.TABLE_4.items()]
CELLS = table_cells()


def section(node, values):
    return {f'/**/{node}': {'ros__parameters': values}}


def measured_percent(run):
    """Simulate a run on its true rig and return the NRMSE of its last four periods."""
    streams = simulate(run.plant, run.compensator, run.controller, run.trajectory)
    scan = run.trajectory
    window = tail(scan.samples, scan.frequency_hz, scan.sample_period_s, 4.0)
    return 100.0 * nrmse(
        streams.reference_um[window], streams.displacement_um[:scan.samples][window])


def decisions(plan):
    return [(run.controller.scheme, run.trajectory.harmonics) for run in plan.runs]


@pytest.fixture
def known_file(config, tmp_path):
    """Write a parameter file of the models that were identified from the simulated rig."""
    (run,) = yaml.safe_load((config / 'experiments' / 'automatic.yaml').read_text())['runs']
    path = tmp_path / 'known.yaml'
    path.write_text(yaml.safe_dump({
        **section('compensator', run['compensator']), **section('trajectory', run['trajectory'])}))
    return path


@pytest.mark.slow
def test_the_plan_that_is_shipped_decides_every_run_as_the_rig_confirms(config):
    plan = read_plan(config / 'experiments' / 'automatic.yaml')
    assert len(plan.runs) == 3
    assert len(set(decisions(plan))) == 3
    assert {run.controller.scheme for run in plan.runs} == {'ff', 'fbff'}
    for run in plan.runs:
        prediction = run.prediction
        assert (prediction.scheme, prediction.chosen.harmonics) == (
            run.controller.scheme, run.trajectory.harmonics)
        assert run.name.split('_')[1] == prediction.scheme
        measured = measured_percent(run)
        assert prediction.nrmse_percent == pytest.approx(measured, rel=0.1)
        assert measured < min(paper.TABLE_4[2.0][run.trajectory.frequency_hz])


def test_a_prediction_tells_every_scheme_and_every_number_of_harmonics(config):
    (run, *_) = read_plan(config / 'experiments' / 'automatic.yaml').runs
    prediction = run.prediction
    assert set(prediction.predicted_nrmse_percent) == {'ff', 'fbff', 'fb'}
    assert min(prediction.predicted_nrmse_percent.values()) == prediction.nrmse_percent
    assert list(prediction.by_harmonics) == list(range(1, 42, 2))
    assert prediction.by_harmonics[prediction.chosen.harmonics] == prediction.nrmse_percent
    least = min(prediction.by_harmonics.values())
    assert prediction.nrmse_percent <= 1.01 * least
    assert all(
        percent > 1.01 * least for m, percent in prediction.by_harmonics.items()
        if m < prediction.chosen.harmonics)
    for words in (f'{prediction.scheme} is predicted to err least', '|S| = 1 at',
                  f'm = {prediction.chosen.harmonics}: {prediction.nrmse_percent:.3g} %'):
        assert words in prediction.reason
    record = prediction.record()
    assert json.loads(json.dumps(record)) == record
    assert record['nrmse_percent'] == prediction.nrmse_percent


def threes(runs):
    """Yield each run of scheme auto with the measured errors of its ff and fbff neighbours."""
    for auto, ff, fbff in zip(runs[::3], runs[1::3], runs[2::3], strict=True):
        assert (ff.controller.scheme, fbff.controller.scheme) == ('ff', 'fbff')
        assert {run.trajectory.frequency_hz for run in (auto, ff, fbff)} == {
            auto.trajectory.frequency_hz}
        yield auto, {'ff': measured_percent(ff), 'fbff': measured_percent(fbff)}


def test_the_recommended_scheme_is_the_better_one_of_the_rig_over_table_4(write_plan, known_file):
    # The nodes are as published; the known rig is identified.
    plan = read_plan(write_plan(
        known_rig_files=[str(known_file)],
        runs=[{**row, 'scheme': ['auto', 'ff', 'fbff']} for row in TABLE]))
    right, deviations = 0, []
    for auto, measured in threes(plan.runs):
        assert auto.trajectory.harmonics == 9
        assert list(auto.prediction.by_harmonics) == [9]
        right += auto.prediction.scheme == min(measured, key=measured.get)
        deviations += [
            auto.prediction.predicted_nrmse_percent[scheme] / measured[scheme] - 1.0
            for scheme in measured]
    assert len(deviations) == 2 * len(CELLS) == 60
    assert right >= 27
    assert np.median(np.abs(deviations)) < 0.03
    assert np.max(np.abs(deviations)) < 0.15


def identified(rig):
    """Identify hysteresis and dynamics from runs of a rig; return sections of a parameter file."""
    bare = simulate_bare(rig, TrajectoryParameters(
        output='voltage', waveform='decreasing_triangle', amplitude_v=4.5, frequency_hz=1.0,
        periods=10.0, harmonics=0, sample_period_s=1e-4))
    hysteresis = fit_hysteresis(bare.voltage_v, bare.displacement_um[:-1]).parameters
    inverse = {
        'kappa_um_per_v': list(hysteresis.kappa_um_per_v),
        'saturation_v': list(hysteresis.saturation_v)}
    responses = []
    for amplitude_um in (0.1, 0.2, 0.4):
        sweep = TrajectoryParameters(
            waveform='stepped_sine', harmonics=0, amplitude_um=amplitude_um, dwell_s=0.05,
            frequencies_hz=[float(f'{f:.4g}') for f in np.geomspace(20.0, 8000.0, 30)])
        run = simulate(
            rig, HysteresisParameters.from_mapping(inverse),
            ControllerParameters(scheme='open_loop'), sweep)
        responses.append(frequency_response(
            run.command_um, run.displacement_um[:-1], sweep.sample_period_s,
            excitation=excitation_of(sweep), voltage_v=run.voltage_v,
            amplifier=Amplifier(rig.slew_limit_v_per_s)))
    dynamics = fit_dynamics(merge(responses)).parameters.to_mapping()
    return {**section('compensator', inverse),
            **section('trajectory', {**dynamics, 'model_response': 'sampled'})}


@pytest.mark.slow
def test_with_models_identified_here_table_4_is_beaten_by_the_scheme_and_harmonics_chosen(
        config, write_plan, tmp_path):
    rig_file = config / 'rig.yaml'
    rig = RigParameters.from_mapping(
        yaml.safe_load(rig_file.read_text())['/**/plant']['ros__parameters'])
    models = tmp_path / 'models.yaml'
    models.write_text(yaml.safe_dump(identified(rig)))
    plan = read_plan(write_plan(
        parameter_files=[str(rig_file), str(models), str(config / 'controller.yaml')],
        runs=[{**row, 'harmonics': 'auto', 'scheme': ['auto', 'ff', 'fbff']} for row in TABLE]))
    beaten = right = chosen_beats = 0
    for (amplitude_um, frequency_hz), (auto, measured) in zip(
            CELLS, threes(plan.runs), strict=True):
        assert auto.trajectory.frequency_hz == frequency_hz
        published = min(paper.TABLE_4[amplitude_um][frequency_hz])
        beaten += min(measured.values()) < published
        right += auto.prediction.scheme == min(measured, key=measured.get)
        chosen_beats += measured_percent(auto) < published
    assert beaten >= 28
    assert right >= 27
    assert chosen_beats >= 28


@pytest.mark.parametrize('mismatch', MISMATCHES)
def test_no_mismatch_of_the_rig_has_any_part_in_the_decision(write_plan, mismatch):
    plan = read_plan(write_plan(runs=[
        {'scheme': 'auto', 'amplitude_um': 2.5, 'frequency_hz': 500.0, 'periods': 5,
         'plant': {mismatch: value}} for value in (-0.3, 0.0, 0.4)]))
    one, *others = plan.runs
    assert all(run.prediction == one.prediction for run in others)
    assert len({getattr(run.plant, mismatch) for run in plan.runs}) == 3


def test_nor_has_what_only_the_rig_knows_of_its_hysteresis_dynamics_order_and_noise(write_plan):
    secrets = [
        {}, {'seed': 77}, {'order': 'lumped'}, {'damping_ratio_2': 0.5, 'time_constant_s': 1e-4},
        {'kappa_um_per_v': [2.0, 1.0], 'saturation_v': [0.3]}]
    plan = read_plan(write_plan(runs=[
        {'scheme': 'ff', 'harmonics': 'auto', 'amplitude_um': 2.5, 'frequency_hz': 800.0,
         'periods': 5, 'plant': secret} for secret in secrets]))
    one, *others = plan.runs
    assert all(run.prediction == one.prediction for run in others)


def test_a_file_that_names_mismatches_gives_away_no_more(write_plan, config):
    run = {'scheme': 'auto', 'frequency_hz': 500.0}
    (without,) = read_plan(write_plan(runs=[run])).runs
    (with_file,) = read_plan(
        write_plan(runs=[run], known_rig_files=[str(config / 'rig.yaml')])).runs
    assert with_file.prediction == without.prediction


@pytest.mark.parametrize(('where', 'file'), [('plant', False), ('known_rig_files', True)])
def test_the_data_sheet_of_the_amplifier_has_a_part_in_it(write_plan, tmp_path, where, file):
    run = {'scheme': 'ff', 'harmonics': 'auto', 'amplitude_um': 2.5, 'frequency_hz': 800.0,
           'periods': 5}
    (slow,) = read_plan(write_plan(runs=[run])).runs
    free = {'slew_limit_v_per_s': 0.0}
    (tmp_path / 'sheet.yaml').write_text(yaml.safe_dump(section('plant', free)))
    (fast,) = read_plan(
        write_plan(runs=[run], known_rig_files=['sheet.yaml']) if file
        else write_plan(runs=[{**run, where: free}])).runs
    assert fast.trajectory.harmonics > slow.trajectory.harmonics
    assert 'the amplifier is at its limits from m = ' in slow.prediction.reason
    assert fast.prediction.nrmse_percent < slow.prediction.nrmse_percent
    # Only the known rig changes, not the simulated one.
    assert fast.plant.slew_limit_v_per_s == (18200.0 if file else 0.0)


def test_an_uncertainty_bound_bars_the_harmonics_that_the_model_does_not_know(
        write_plan, tmp_path):
    run = {'scheme': 'ff', 'harmonics': 'auto', 'amplitude_um': 0.5, 'frequency_hz': 400.0}
    corner_rad_per_s = 2.0 * math.pi * 3000.0
    (tmp_path / 'bound.yaml').write_text(yaml.safe_dump({
        'format_version': 1, 'kind': 'uncertainty_bound',
        'numerator': [4.0, 0.0, 0.0], 'denominator': [1.0, 0.2, corner_rad_per_s**2 / 1e4]}))
    (sure,) = read_plan(write_plan(runs=[run])).runs
    (unsure,) = read_plan(
        write_plan(runs=[run], uncertainty_bound_file='bound.yaml')).runs
    assert unsure.trajectory.harmonics < sure.trajectory.harmonics
    assert unsure.prediction.nrmse_percent > sure.prediction.nrmse_percent


def test_a_scheme_without_feedforward_has_no_harmonics_to_decide(write_plan):
    plan = read_plan(write_plan(runs=[
        {'scheme': ['fb', 'open_loop'], 'harmonics': 'auto', 'periods': 5}]))
    assert decisions(plan) == [('fb', 0), ('open_loop', 0)]
    assert all(run.prediction is None for run in plan.runs)


def test_feedback_that_would_not_be_stable_is_not_recommended(write_plan):
    (run,) = read_plan(write_plan(runs=[
        {'scheme': 'auto', 'harmonics': 'auto', 'controller': {'proportional_gain': 30.0}}])).runs
    assert run.controller.scheme == 'ff'
    assert set(run.prediction.predicted_nrmse_percent) == {'ff'}
    assert 'the loop is not stable' in run.prediction.reason


def test_a_run_that_leaves_nothing_open_has_no_prediction(write_plan):
    (run,) = read_plan(write_plan()).runs
    assert run.prediction is None


def test_auto_in_the_section_of_a_node_is_decided_too(write_plan):
    (run,) = read_plan(write_plan(runs=[
        {'controller': {'scheme': 'auto'}, 'trajectory': {'harmonics': 'auto'},
         'waveform': 'sine', 'frequency_hz': 900.0}])).runs
    assert run.prediction.chosen.harmonics == run.trajectory.harmonics
    assert run.controller.scheme == 'ff'
    assert run.trajectory.harmonics == 1


def test_the_scored_periods_of_the_plan_are_the_predicted_ones(write_plan):
    run = {'scheme': 'auto', 'frequency_hz': 300.0, 'periods': 5}
    # The first periods contain the start from rest.
    last, all_ = (
        read_plan(write_plan(runs=[run], score_periods=count)).runs[0].prediction
        for count in (1, 5))
    assert all_.nrmse_percent > 1.5 * last.nrmse_percent


def test_runs_that_a_program_plans_may_leave_things_open_as_well(config):
    base = {node: {} for node in ('compensator', 'controller', 'plant', 'trajectory')}
    run = plan_run(base, {'scheme': 'auto', 'harmonics': 'auto'}, where='here', number=7)
    assert run.prediction.chosen.harmonics == run.trajectory.harmonics > 0
    assert run.name == f'007_{run.controller.scheme}_triangle_1um_300hz'


@pytest.mark.parametrize(('keys', 'fragments'), [
    ({'runs': [{'harmonics': 'many'}]}, ["harmonics is 'many', it must be an integer"]),
    ({'runs': [{'scheme': 'automatic'}]}, ["scheme is 'automatic', allowed are fb, ff, fbff"]),
    ({'runs': [{'amplitude_um': 'auto'}]}, ["amplitude_um is 'auto', it must be a number"]),
    ({'runs': [{'scheme': 'auto', 'waveform': 'multisine', 'harmonics': 0}]},
     ["run 1: scheme auto: waveform is 'multisine'", 'triangle, sine']),
    ({'runs': [{'harmonics': 'auto', 'scheme': 'ff', 'waveform': 'decreasing_triangle'}]},
     ["run 1: harmonics auto: waveform is 'decreasing_triangle'"]),
    ({'runs': [{'scheme': 'auto', 'harmonics': 0, 'output': 'voltage', 'amplitude_v': 1.0}]},
     ['run 1: scheme has no effect', 'output is voltage']),
    ({'runs': [{'scheme': 'auto', 'periods': 3}]},
     ['run 1: scheme auto: score_periods is 4, allowed is above 0 … 3.0']),
    ({'runs': [{'scheme': 'auto', 'harmonics': 'auto', 'amplitude_um': 7.0}]},
     ['run 1: amplitude_um is 7.0 um', 'travels 6 um']),
    ({'runs': [{'scheme': 'auto', 'controller': {
        'proportional_gain': 0, 'integral_gain_per_s': 0}}]}, ['run 1: scheme auto: ', 'gain']),
    ({'known_rig_files': 'rig.yaml'}, ["known_rig_files is 'rig.yaml', it must be a list"]),
    ({'known_rig_files': ['none.yaml']}, ['none.yaml: No such file or directory']),
    ({'known_rig_files': ['odd.yaml']}, ["odd.yaml:3: plant: unknown parameter 'slew'"]),
    ({'known_rig_files': ['other.yaml']},
     ['known_rig_files say nothing of compensator, plant, trajectory']),
    ({'known_rig_files': ['half.yaml'], 'runs': [{'scheme': 'auto'}]},
     ['half.yaml:3: compensator: kappa_um_per_v has 11 values and saturation_v 1']),
    ({'uncertainty_bound_file': 'none.yaml'}, ['none.yaml: No such file or directory']),
    ({'uncertainty_bound_file': 'odd.yaml'}, ['odd.yaml is no uncertainty_bound']),
    ({'runs': ..., 'study': 'paper', 'known_rig_files': []},
     ['a study makes its own runs, there must be no key known_rig_files']),
])
def test_a_plan_that_cannot_be_decided_is_refused_in_words(write_plan, tmp_path, keys, fragments):
    for name, content in (
            ('odd', section('plant', {'slew': 1.0})),
            ('other', section('recorder', {'compression': 'none'})),
            ('half', section('compensator', {'saturation_v': [0.1]}))):
        (tmp_path / f'{name}.yaml').write_text(yaml.safe_dump(content))
    with pytest.raises(PlanError) as refusal:
        read_plan(write_plan(**keys))
    message = str(refusal.value)
    assert message.startswith(str(tmp_path))
    for fragment in fragments:
        assert fragment in message
