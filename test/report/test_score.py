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

import dataclasses

import numpy as np
import pytest

from piezo_ros.bag import BagWriter, read
from piezo_ros.report import score


def test_only_the_last_four_periods_are_scored(make_run):
    run = make_run('ff')
    run.displacement_um[:] = run.reference_um
    run.displacement_um[: 6000 - 1333] += 1.0
    assert score(run, bag='b', wall_seconds=1.0).max_error_um == 0.0
    run.displacement_um[6000 - 1333] += 0.25
    assert score(run, bag='b', wall_seconds=1.0).max_error_um == 0.25


def test_the_window_keeps_the_time_of_the_run(make_run):
    run = score(make_run(start_index=100), periods=2, bag='b', wall_seconds=1.0)
    assert run.time_s.size == run.reference_um.size == run.voltage_v.size == 666
    assert run.time_s[-1] == pytest.approx(6099e-5)
    assert run.window_ms[0] == 0.0
    assert run.window_ms[-1] == pytest.approx(6.65)


def test_error_is_reference_minus_displacement(make_run):
    run = score(make_run(), bag='b', wall_seconds=1.0)
    assert np.array_equal(run.error_um, run.reference_um - run.displacement_um)
    assert run.nrmse_percent == pytest.approx(
        100 * np.sqrt(np.mean(run.error_um**2)) / np.ptp(run.reference_um))


@pytest.mark.parametrize(('scheme', 'changes', 'published'), [
    ('ff', {}, 2.10),
    ('fbff', {}, 1.22),
    ('fb', {}, None),
    ('ff', {'harmonics': '15'}, None),
    ('ff', {'waveform': 'sine'}, None),
    ('ff', {'frequency_hz': '350'}, None),
    ('ff', {'amplitude_um': '2'}, 2.10),
])
def test_the_published_number_stands_only_beside_its_own_experiment(
        make_run, scheme, changes, published):
    run = score(make_run(scheme, **changes), bag='b', wall_seconds=1.0)
    assert run.paper_nrmse_percent == published
    assert ('paper_nrmse_percent' in run.record()) == (published is not None)


def test_deviation_is_relative_to_the_published_number(make_run):
    run = dataclasses.replace(
        score(make_run(), bag='b', wall_seconds=4.0), nrmse_percent=2.31)
    assert run.deviation_percent == pytest.approx(10.0)
    assert dataclasses.replace(run, paper_nrmse_percent=None).deviation_percent is None


def test_rate_is_samples_per_wall_second_where_the_wall_time_is_known(make_run):
    assert score(make_run(), bag='b', wall_seconds=4.0).samples_per_wall_second == 1500.0
    assert score(make_run(), bag='b', wall_seconds=0.0).samples_per_wall_second is None


@pytest.mark.parametrize('key', [
    'scheme', 'waveform', 'amplitude_um', 'frequency_hz', 'harmonics'])
def test_a_missing_entry_is_named(make_run, key):
    run = make_run()
    del run.metadata[key]
    with pytest.raises(ValueError, match=key):
        score(run, bag='b', wall_seconds=1.0)


@pytest.mark.parametrize(('key', 'text'), [
    ('amplitude_um', 'large'), ('frequency_hz', 'nan'), ('harmonics', '9.5')])
def test_an_unreadable_entry_is_named_with_its_value(make_run, key, text):
    run = make_run()
    run.metadata[key] = text
    with pytest.raises(ValueError, match=rf'{key} of the run is .*{text}'):
        score(run, bag='b', wall_seconds=1.0)


@pytest.mark.parametrize('seconds', [-1.0, float('nan'), float('inf')])
def test_an_impossible_wall_time_is_refused(make_run, seconds):
    with pytest.raises(ValueError, match=f'wall_seconds is {seconds}'):
        score(make_run(), bag='b', wall_seconds=seconds)


def test_a_run_shorter_than_the_window_is_refused(make_run):
    with pytest.raises(ValueError, match='1333 samples'):
        score(make_run(samples=1000), bag='b', wall_seconds=1.0)


def test_a_recorded_run_scores_as_it_did_before_it_was_recorded(make_run, tmp_path):
    run = make_run('fbff')
    with BagWriter(tmp_path / 'bag', metadata=run.metadata) as bag:
        for stream, samples in (('reference', run.reference_um), ('voltage', run.voltage_v),
                                ('displacement', [*run.displacement_um, 7.0])):
            bag.write_block(stream, 0, run.sample_period_s, samples)
            bag.write_block(stream, len(samples), run.sample_period_s, [])
    recorded = score(read(tmp_path / 'bag'), bag='b', wall_seconds=1.0)
    assert recorded == score(run, bag='b', wall_seconds=1.0)
    assert np.array_equal(recorded.time_s, score(run, bag='b', wall_seconds=1.0).time_s)


def test_importing_the_metrics_does_not_import_matplotlib():
    import subprocess
    import sys
    code = 'import sys; from piezo_ros.report import nrmse; sys.exit("matplotlib" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
