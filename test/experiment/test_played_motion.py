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

"""A motion out of a file in a whole run: planned, simulated, refused."""

from dataclasses import replace

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.tables.motion_table import (
    MotionTable,
    MotionTableError,
    read_motion_table,
    write_motion_table,
)
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.experiment.plan import read_plan
from piezo_ros.model import HysteresisParameters, ParameterError, RigParameters
from piezo_ros.parameters.errors import PlanError

PERIOD_S = 1e-5
PLAN = """\
format_version: 1
parameter_files: []
runs:
  - scheme: ff
    waveform: file
    file: {file}
    frequency_hz: 500.0
    periods: 4
"""


@pytest.fixture
def motion(tmp_path):
    """Write a motion of a start of 100 samples and a period of 200."""
    turns = np.arange(300) / 200
    table = MotionTable(
        np.sin(2.0 * np.pi * turns) * np.minimum(turns * 2.0, 1.0),
        1.02 * np.sin(2.0 * np.pi * (turns + 0.01)) * np.minimum(turns * 2.0, 1.0),
        PERIOD_S, repeat_from=100)
    write_motion_table(tmp_path / 'motion.npz', table)
    return tmp_path / 'motion.npz', table


def trajectory(path, **given):
    return TrajectoryParameters(
        waveform='file', file=str(path), frequency_hz=500.0,
        **{'periods': 5.0, 'harmonics': 0, **given})


@pytest.mark.parametrize('compiled', [False, True])
def test_the_motion_is_played_start_first_then_its_period(motion, compiled):
    path, table = motion
    parameters = trajectory(path)
    assert parameters.samples == 1000
    blocks = trajectory_blocks(parameters, compiled=compiled)
    places = [table.place(k) for k in range(1000)]
    reference_um, command_um = (np.concatenate(parts) for parts in zip(
        *(blocks(start, 125) for start in range(0, 1000, 125)), strict=True))
    np.testing.assert_array_equal(reference_um, table.reference_um[places])
    np.testing.assert_array_equal(command_um, table.command_um[places])


def test_a_motion_without_repetition_is_as_long_as_its_table(tmp_path):
    write_motion_table(tmp_path / 'once.npz', MotionTable(np.linspace(0.0, 1.0, 77), None, 1e-5))
    parameters = trajectory(tmp_path / 'once.npz')
    assert parameters.samples == 77
    _, feedforward_um = trajectory_blocks(parameters)(0, 77)
    np.testing.assert_allclose(
        feedforward_um, np.linspace(0.0, 1.0, 77) / parameters.dc_gain, rtol=1e-15)


def test_the_scheme_ff_sends_the_commands_of_the_file(motion):
    path, table = motion
    run = simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(scheme='ff'),
        trajectory(path))
    np.testing.assert_array_equal(
        run.command_um, table.command_um[[table.place(k) for k in range(1000)]])


def test_a_plan_takes_a_file(motion, tmp_path):
    path, _ = motion
    (tmp_path / 'plan.yaml').write_text(PLAN.format(file=path))
    (run,) = read_plan(tmp_path / 'plan.yaml').runs
    assert run.name == '000_ff_file_1um_500hz'
    assert run.trajectory.samples == 800


def test_what_is_known_of_a_run_does_not_need_its_file(motion):
    path, _ = motion
    parameters = trajectory(path)
    path.unlink()
    assert TrajectoryParameters.from_mapping(parameters.to_mapping()) == parameters
    with pytest.raises(MotionTableError, match=r'motion\.npz: No such file'):
        trajectory_blocks(parameters)


def test_a_file_that_changes_is_read_anew(motion):
    path, table = motion
    parameters = trajectory(path)
    before, _ = trajectory_blocks(parameters)(0, 10)
    write_motion_table(path, MotionTable(2.0 * table.reference_um, None, PERIOD_S, 100))
    after, _ = trajectory_blocks(parameters)(0, 10)
    np.testing.assert_array_equal(after, 2.0 * np.array(before))


@pytest.mark.parametrize(('given', 'problem'), [
    ({'waveform': 'file'}, "file is '' and waveform 'file'"),
    ({'waveform': 'triangle', 'file': 'x.csv'}, "file is 'x.csv' and waveform 'triangle'"),
    ({'waveform': 'file', 'file': 'x.csv', 'output': 'voltage'}, 'output is voltage'),
])
def test_a_file_belongs_to_its_waveform(given, problem):
    with pytest.raises(ParameterError, match=problem):
        TrajectoryParameters(harmonics=0, **given)


@pytest.mark.parametrize(('reference_um', 'problem'), [
    (np.linspace(0.0, 7.0, 1000), 'motion.npz: it reaches 7 um'),
    (np.zeros(10), 'it reaches 0 um, it must be above 0'),
    (np.concatenate([np.zeros(10), np.ones(10)]), 'jumps by 1 um from sample 9 to sample 10'),
])
def test_a_plan_refuses_what_the_stage_cannot_make(tmp_path, reference_um, problem):
    write_motion_table(tmp_path / 'motion.npz', MotionTable(reference_um, None, PERIOD_S))
    (tmp_path / 'plan.yaml').write_text(
        PLAN.format(file=tmp_path / 'motion.npz')
        + '    plant: {slew_limit_v_per_s: 18200.0}\n')
    with pytest.raises(PlanError, match=problem):
        read_plan(tmp_path / 'plan.yaml')


@pytest.mark.parametrize('more', [
    'kappa_um_per_v: [1.41]',
    'kappa_um_per_v: [1.28], asymmetry_threshold_um: [0.5], asymmetry_weight: [0.1]'])
def test_a_step_may_be_as_large_as_the_compensator_makes_it_of_the_slew_limit(tmp_path, more):
    # 1.28 um/V allow 0.233 um in a sample period, 1.41 um/V 0.257.
    ramp_um = np.minimum(0.25 * np.arange(1000.0), 5.0)
    write_motion_table(tmp_path / 'motion.npz', MotionTable(ramp_um, None, PERIOD_S))
    plan = PLAN.format(file=tmp_path / 'motion.npz') + (
        '    plant: {slew_limit_v_per_s: 18200.0, kappa_um_per_v: [1.28], saturation_v: []}\n'
        '    compensator: {kappa_um_per_v: [1.28], saturation_v: []}\n')
    (tmp_path / 'plan.yaml').write_text(plan)
    with pytest.raises(PlanError, match=r'jumps by 0.25 um'):
        read_plan(tmp_path / 'plan.yaml')
    before, after = plan.rsplit('kappa_um_per_v: [1.28]', 1)
    (tmp_path / 'plan.yaml').write_text(before + more + after)
    assert read_plan(tmp_path / 'plan.yaml').runs


def test_a_plan_refuses_commands_that_the_controller_would_cut_off(tmp_path):
    ramp_um = np.linspace(0.0, 2.0, 1000)
    write_motion_table(tmp_path / 'motion.npz', MotionTable(ramp_um, 1.1 * ramp_um, PERIOD_S))
    (tmp_path / 'plan.yaml').write_text(
        PLAN.format(file=tmp_path / 'motion.npz') + '    controller: {command_maximum_um: 2.1}\n')
    with pytest.raises(PlanError, match=r'command_um is 2.2 um, the controller allows -8 … 2.1'):
        read_plan(tmp_path / 'plan.yaml')


@pytest.mark.parametrize(('table', 'changes', 'problem'), [
    (MotionTable(np.cos(np.arange(200) / 200 * 2 * np.pi), None, PERIOD_S, 0), '',
     r'motion.npz: reference_um is 1 um at sample 0, allowed is -0.2\d* … 0.2\d* um: a run begins'),
    (MotionTable(np.sin(np.arange(150) / 200 * 2 * np.pi), None, PERIOD_S, 0), '',
     r'jumps by 0.9995\d* um from sample 149 to the first .*: it does not close on itself'),
    (MotionTable(np.sin(np.arange(201) / 201 * 2 * np.pi), None, PERIOD_S, 0), '',
     r'it repeats 201 samples, 1.005 periods of frequency_hz 500 Hz \(200 samples each\)'),
    (MotionTable(np.sin(np.arange(200) / 200 * 2 * np.pi), None, PERIOD_S), '',
     'it has 200 samples, played once; score_periods is 4, which are 800 samples'),
    (MotionTable(np.sin(np.arange(200) / 200 * 2 * np.pi), None, PERIOD_S, 0),
     '    offset_um: 5.5\n', 'beside the offset of 5.5 um that leaves 0.5 um'),
    (MotionTable(np.sin(np.arange(200) / 200 * 2 * np.pi), np.zeros(200), PERIOD_S, 0),
     '    offset_um: 1.0\n', 'it has commands, which belong to its own reference: offset_um is 1'),
])
def test_a_plan_refuses_a_table_that_does_not_fit_its_run(tmp_path, table, changes, problem):
    write_motion_table(tmp_path / 'motion.npz', table)
    (tmp_path / 'plan.yaml').write_text(
        PLAN.format(file=tmp_path / 'motion.npz') + changes
        + '    plant: {slew_limit_v_per_s: 18200.0, kappa_um_per_v: [1.28], saturation_v: []}\n')
    with pytest.raises(PlanError, match=problem):
        read_plan(tmp_path / 'plan.yaml')


def test_a_period_that_begins_anywhere_is_played_with_soft_start_and_offset(tmp_path):
    period_um = np.cos(np.arange(200) / 200 * 2 * np.pi)
    write_motion_table(tmp_path / 'motion.npz', MotionTable(period_um, None, PERIOD_S, 0))
    (tmp_path / 'plan.yaml').write_text(
        PLAN.format(file=tmp_path / 'motion.npz')
        + '    offset_um: 1.0\n    ramp_periods: 2\n    plant: {slew_limit_v_per_s: 18200.0}\n')
    (run,) = read_plan(tmp_path / 'plan.yaml').runs
    reference_um, feedforward_um = trajectory_blocks(run.trajectory)(0, 800)
    assert reference_um[0] == 0.0
    np.testing.assert_array_equal(reference_um[400:600], period_um + 1.0)
    np.testing.assert_array_equal(
        feedforward_um[400:600], 1.0 / run.trajectory.dc_gain * (period_um + 1.0))


def test_a_plan_names_a_file_that_is_not_there(tmp_path):
    (tmp_path / 'plan.yaml').write_text(PLAN.format(file='none.npz'))
    with pytest.raises(PlanError, match='none.npz: No such file'):
        read_plan(tmp_path / 'plan.yaml')


def changed_plan(tmp_path, path, factor, at_sample=650):
    table = read_motion_table(path, PERIOD_S)
    other = tmp_path / 'other.npz'
    write_motion_table(other, replace(table, command_um=factor * table.command_um))
    plan = tmp_path / 'plan.yaml'
    plan.write_text(PLAN.format(file=path) + (
        f'    changes:\n      - {{at_sample: {at_sample}, file: {other}}}\n'
        '      - {at_sample: 700, proportional_gain: 0.3}\n'))
    return plan, other


def test_a_plan_lists_another_file_beside_other_gains(motion, tmp_path):
    path, table = motion
    plan, other = changed_plan(tmp_path, path, 1.01)
    (run,) = read_plan(plan).runs
    assert 'another file from sample 650 on' in run.description
    assert [change.at_sample for change in run.changes] == [700]
    _, command_um = trajectory_blocks(run.trajectory)(0, 800)
    expected = table.command_um[[table.place(k) for k in range(800)]]
    expected[650:] = read_motion_table(other, PERIOD_S).command_um[
        [table.place(k) for k in range(650, 800)]]
    np.testing.assert_array_equal(command_um, expected)


@pytest.mark.parametrize(('factor', 'at_sample', 'culprit'), [
    (9.0, 650, 'other.npz: it reaches'),
    (2.5, 650, 'other.npz: command_um steps by'),
    (1.01, 800, 'other.npz: at_sample is 800, the run has 800 samples'),
])
def test_a_plan_with_a_bad_table_is_refused_before_anything_runs(
        motion, tmp_path, factor, at_sample, culprit):
    plan, _ = changed_plan(tmp_path, motion[0], factor, at_sample)
    with pytest.raises(PlanError, match=culprit):
        read_plan(plan)
