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
"""Raster scans of a plan: what is read, what is refused by name."""

import pytest
import yaml

from piezo_ros.experiment.plan import read_plan
from piezo_ros.parameters.errors import PlanError

SCAN = {'fast': {'amplitude_um': 1.0, 'frequency_hz': 500.0}}


@pytest.fixture
def scans_plan(write_plan):
    def write(*scans, **keys):
        return write_plan(runs=..., scans=list(scans) or [SCAN], **keys)

    return write


def fast(**values):
    return {'fast': {**SCAN['fast'], **values}}


def test_a_list_of_the_fast_axis_stands_for_one_scan_each(scans_plan):
    plan = read_plan(scans_plan(
        fast(motion=['waveform', 'planned', 'learned'], scheme='ff', harmonics=9),
        {**fast(amplitude_um=[1.0, 2.0]), 'name': 'two sizes'}))
    assert plan.runs == ()
    assert [(scan.variant, scan.case) for scan in plan.scans] == [
        ('ff, m = 9', '256 lines of 2 µm at 500 Hz'), ('planned', '256 lines of 2 µm at 500 Hz'),
        ('learned', '256 lines of 2 µm at 500 Hz'), *[('fbff, m = 9', 'two sizes')] * 2]
    assert len({scan.name for scan in plan.scans}) == 5
    assert [scan.size_um for scan in plan.scans[-2:]] == [1.6, 3.2]  # a square image


def test_what_scans_have_in_common_gives_way_to_what_each_says(scans_plan):
    plan = read_plan(scans_plan(
        SCAN, {**fast(plant={'seed': 7}), 'lines': 16},
        scan_defaults={
            'lines': 8, 'fast': {'plant': {'seed': 3, 'noise_rms_um': 0.0}},
            'slow': {'motion': 'preview', 'size_um': 0.5}}))
    first, second = plan.scans
    assert (first.lines, second.lines) == (8, 16)
    assert (first.fast_run.plant.seed, second.fast_run.plant.seed) == (3, 7)
    assert second.fast_run.plant.noise_rms_um == 0.0
    assert (second.slow.motion, second.size_um) == ('preview', 0.5)


def test_each_axis_may_be_a_rig_of_its_own(scans_plan, tmp_path):
    for name, seed in (('x', 11), ('y', 22)):
        (tmp_path / f'{name}.yaml').write_text(yaml.safe_dump(
            {'/**/plant': {'ros__parameters': {'seed': seed}}}))
    plan = read_plan(scans_plan(
        {**fast(parameter_files=['x.yaml']), 'slow': {'parameter_files': ['y.yaml']}}))
    (scan,) = plan.scans
    assert (scan.fast_run.plant.seed, scan.slow_run.plant.seed) == (11, 22)


@pytest.mark.parametrize(('scan', 'problem'), [
    ({'fast': {}, 'lins': 3}, "scan 1: unknown key 'lins'; allowed are name, lines"),
    (fast(periods=3), "scan 1: fast: unknown key 'periods'"),
    (fast(output='voltage'), "scan 1: fast: unknown key 'output'"),
    ({**SCAN, 'slow': {'waveform': 'sine'}}, "scan 1: slow: unknown key 'waveform'"),
    ({**SCAN, 'slow': 3}, 'scan 1: slow is 3, it must be a mapping'),
    (7, 'scan 1 is 7, it must be a mapping'),
    (fast(motion='guessed'), "motion is 'guessed', allowed are waveform, planned, learned"),
    (fast(motion=[]), 'motion is an empty list'),
    (fast(waveform='multisine'), "waveform is 'multisine', allowed are triangle, sine"),
    (fast(amplitude_um=50.0), 'fast: amplitude_um is 50.0 um'),
    (fast(free_turn=1.0), 'fast: free_turn is 1.0, allowed is 0 … 0.89'),
    (fast(free_turn=float('nan')), 'fast: free_turn is nan, allowed is 0 … 0.89'),
    (fast(learning_runs=2.5), 'learning_runs is 2.5, it must be a whole number'),
    (fast(frequency_hz=6e4), 'fast: .*frequency_hz is 60000'),
    ({**SCAN, 'lines': 1}, 'lines is 1, allowed is 2 … 100000'),
    ({**SCAN, 'lines': True}, 'lines is True, it must be a whole number'),
    ({**SCAN, 'central': 0}, 'central is 0, allowed is 0.01 … 1'),
    ({**SCAN, 'slow': {'size_um': 100.0}}, 'slow: amplitude_um is 50.0 um'),
    (fast(trajectory={'output': 'voltage'}), 'fast: output is voltage'),
    (fast(trajectory={'periods': 3}), 'fast: trajectory: periods has no effect: the scan decides'),
    (fast(trajectory={'amplitude_um': 1.0}), 'fast: trajectory: amplitude_um is 1.0 and amplitude'),
    (fast(stairs=3), 'fast: stairs has no effect: waveform is triangle, it is for staircase'),
    ({**SCAN, 'slow': {node: {'sample_period_s': 2e-5} for node in (
        'plant', 'controller', 'compensator', 'trajectory')}},
     'sample_period_s is 1e-05 s of the fast axis and 2e-05 s of the slow one'),
])
def test_a_scan_that_cannot_be_is_refused_by_name(scans_plan, scan, problem):
    with pytest.raises(PlanError, match=problem):
        read_plan(scans_plan(scan))


@pytest.mark.parametrize(('keys', 'problem'), [
    ({'runs': [{}]}, 'beside scans there must be no key runs'),
    ({'runs': ..., 'score_periods': 3}, 'beside scans there must be no key score_periods'),
    ({'runs': ..., 'scans': []}, r'scans is \[\], it must be a list of one at least'),
    ({'scans': ..., 'scan_defaults': {'lines': 3}}, 'scan_defaults belong to scans'),
    ({'runs': ..., 'scan_defaults': {'line': 3}}, "scan_defaults: unknown key 'line'"),
])
def test_a_plan_has_scans_or_runs(write_plan, keys, problem):
    with pytest.raises(PlanError, match=problem):
        read_plan(write_plan(**{'scans': [SCAN], **keys}))
