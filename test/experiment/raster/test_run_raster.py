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
"""The raster scans of a plan, offline: planned, learned, imaged; refused before anything moves."""

import json

import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.raster_scan import AXES
from piezo_ros.experiment.raster import run_raster as module
from piezo_ros.experiment.raster.motions import check_scans
from piezo_ros.experiment.raster.offline_rigs import OfflineRigs
from piezo_ros.experiment.raster.recorded_scans import recorded_scans
from piezo_ros.experiment.raster.run_raster import run_raster
from piezo_ros.parameters.errors import CampaignError, PlanError

SLOW = {
    'motion': 'preview', 'scheme': 'fbff', 'controller': {'reference_delay_samples': 1},
    'plant': {'creep_per_decade': 0.02, 'seed': 2}}


@pytest.fixture
def raster_plan(write_plan, config):
    """Write a plan of a few lines."""

    def write(*fast, lines=6, slow=SLOW, **keys):
        return read_plan(write_plan(
            runs=..., known_rig_files=[str(config / 'identified.yaml')],
            scan_defaults={'lines': lines, 'pixels': 64, 'slow': slow},
            scans=[{'fast': each} for each in fast], **keys))

    return write


@pytest.fixture
def output(tmp_path, monkeypatch):
    """Return an output directory; the page is not drawn."""
    pages = []

    def note(directory, **content):
        pages.append(content)
        return directory / 'report.html'

    monkeypatch.setattr(module, 'write_raster_report', note)
    directory = tmp_path / 'out'
    prepare_directory(directory, force=False)
    return directory, pages


FAST = {'amplitude_um': 2.0, 'frequency_hz': 800.0, 'scheme': 'ff', 'harmonics': 9}


def test_planned_and_learned_scans_show_what_the_published_one_blurs(raster_plan, output):
    directory, pages = output
    plan = raster_plan({
        **FAST, 'motion': ['waveform', 'planned', 'learned'], 'learning_runs': 2})
    campaign = run_raster(plan, directory, OfflineRigs())
    published, planned, learned = (scan.quality for scan in campaign.scans)
    assert published.rms_px > 2.0
    assert abs(published.scale_error_percent) > 5.0
    assert planned.rms_px < 0.1 * published.rms_px
    assert learned.line_rms_percent < min(0.12, 0.7 * planned.line_rms_percent)
    assert learned.rms_px < 0.3
    assert abs(learned.trace_retrace_mean_px) < 0.1
    assert all(scan.images.nominal_y_um.size == 6 for scan in campaign.scans)
    assert 'learning runs, weighted error' in pages[0]['notes'][0]
    # Both axes have as many samples, of the same time, and never exceed the slew limit.
    for scan in plan.scans:
        runs = {axis: read(directory / 'bags' / scan.name / axis) for axis in AXES}
        assert runs['fast'].samples == runs['slow'].samples
        if scan.fast.motion != 'waveform':
            slew_v_per_s = np.abs(np.diff(runs['fast'].voltage_v)) / 1e-5
            assert slew_v_per_s.max() < 18200.0 * (1.0 + 1e-5)
    # The bags are enough to report the scans again.
    again = recorded_scans(directory, directory)
    assert [scan.quality for scan in again] == [scan.quality for scan in campaign.scans]


def test_an_axis_that_cannot_follow_is_refused_before_anything_moves(raster_plan, output):
    directory, pages = output
    plan = raster_plan({**FAST, 'motion': 'waveform'}, {
        **FAST, 'motion': 'planned', 'amplitude_um': 5.5, 'frequency_hz': 2000.0})
    with pytest.raises(PlanError, match='scan 2: fast: planned: amplitude_um is 5.5 at 2000 Hz'):
        run_raster(plan, directory, OfflineRigs())
    assert not (directory / 'bags').exists()
    assert not pages


def test_a_slow_axis_that_is_too_quick_is_refused_by_name(raster_plan, output):
    plan = raster_plan(FAST, slow={**SLOW, 'approach_s': 1e-4, 'size_um': 8.0})
    with pytest.raises(PlanError, match='scan 1: slow: preview: the slope of the voltage'):
        run_raster(plan, output[0], OfflineRigs())


def test_scans_before_a_failure_are_reported(raster_plan, output):
    directory, pages = output
    plan = raster_plan({**FAST, 'amplitude_um': [1.0, 2.0]})

    class Failing(OfflineRigs):
        def together(self, planned, bags):
            if '001' in str(bags['fast']):
                raise CampaignError('slow axis: plant failed')
            return super().together(planned, bags)

    with pytest.raises(CampaignError, match='001_waveform_4um_800hz: slow axis: plant failed'):
        run_raster(plan, directory, Failing())
    (page,) = pages
    assert len(page['scans']) == 1
    assert 'ended at scan 2' in page['notes'][-1]


def test_a_learning_that_fails_ends_the_campaign(raster_plan, output):
    plan = raster_plan({**FAST, 'motion': 'learned'})

    class Failing(OfflineRigs):
        def alone(self, planned, bag):
            raise CampaignError('plant failed')

    with pytest.raises(CampaignError, match='000_learned_4um_800hz: plant failed'):
        run_raster(plan, output[0], Failing())


@pytest.mark.slow
def test_learning_runs_have_names_of_their_own(raster_plan, output):
    directory, _ = output
    names = []

    class Named(OfflineRigs):
        def alone(self, planned, bag):
            names.append(planned.name)
            return simulate_run(planned, bag)

    run_raster(
        raster_plan({**FAST, 'motion': 'learned', 'learning_runs': 1, 'frequency_hz': [500, 800]}),
        directory, Named())
    assert len(set(names)) == len(names) == 2


def test_what_scans_ask_of_their_rigs_is_checked(raster_plan):
    plan = raster_plan({**FAST, 'motion': ['waveform', 'planned']})
    beyond = {demand.name: demand.beyond for demand in check_scans(plan.scans)}
    assert beyond == {
        '000_waveform_4um_800hz_fast': True, '000_waveform_4um_800hz_slow': False,
        '001_planned_4um_800hz_fast': False, '001_planned_4um_800hz_slow': False}


@pytest.mark.parametrize('content', [
    '{', '[]', '{"scans": [{"name": "a"}]}', '{"scans": 3, "format_version": 1}',
    json.dumps({'format_version': 2, 'scans': []}),
    json.dumps({'format_version': 1, 'scans': [{
        'name': '../a', 'case': '', 'variant': '', 'pixels': 3, 'central': 0.8}]})])
def test_a_damaged_record_is_named(tmp_path, content):
    (tmp_path / 'scans.json').write_text(content)
    with pytest.raises(ValueError, match=r'scans\.json'):
        recorded_scans(tmp_path, tmp_path)


# Of the page "beyond the paper": free turns of 20 %.
CELLS = [(1.0, 300.0, 0.0), (1.0, 800.0, 0.0), (2.0, 300.0, 0.0), (2.0, 600.0, 0.0),
         (2.5, 800.0, 20000.0)]


@pytest.mark.slow
@pytest.mark.parametrize(('amplitude_um', 'frequency_hz', 'band_hz'), CELLS)
def test_learned_free_turns_leave_a_tenth_of_a_percent(
        raster_plan, output, amplitude_um, frequency_hz, band_hz):
    plan = raster_plan({
        'motion': 'learned', 'scheme': 'ff', 'amplitude_um': amplitude_um,
        'frequency_hz': frequency_hz, 'band_hz': band_hz}, lines=64)
    (scan,) = run_raster(plan, output[0], OfflineRigs()).scans
    assert scan.quality.line_rms_percent < 0.12
    assert scan.quality.rms_px < 0.3 * 64 / 256
    assert abs(scan.quality.trace_retrace_mean_px) < 0.1 * 64 / 256
    assert scan.quality.correlation > 0.99


@pytest.mark.slow
def test_sixty_seconds_of_lines_after_a_move_stay_where_they_are_with_feedback(config):
    from piezo_ros.control import ControllerParameters
    from piezo_ros.control.closed_loop import run_loop
    from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters
    from piezo_ros.model.noise import unit_noise
    from piezo_ros.parameters.parameter_file import read_parameter_set
    rig = read_parameter_set(config / 'rig.yaml', 'plant', RigParameters).replaced(
        creep_per_decade=0.02)
    hysteresis = read_parameter_set(
        config / 'identified.yaml', 'compensator', HysteresisParameters)
    dynamics = read_parameter_set(config / 'identified.yaml', 'trajectory', DynamicsParameters)
    line, moved, lines = 100_000, 5_000, 60
    k = np.arange(lines * line + moved)
    q = np.clip(k / 1000.0, 0.0, 1.0)
    y_um = 2.0 * q**4 * (35.0 - q * (84.0 - q * (70.0 - 20.0 * q))) + (
        2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * np.maximum(k - moved, 0) / line)))
    drift_nm, rms_nm = {}, {}
    for scheme in ('ff', 'fbff'):
        run = run_loop(
            rig, hysteresis, ControllerParameters(scheme=scheme, reference_delay_samples=1), 1e-5,
            y_um, y_um / dynamics.dc_gain)
        tip_um = run.displacement_um[:-1] - rig.noise_rms_um * unit_noise(rig.seed, 0, k.size)
        error_nm = 1e3 * (tip_um - y_um)[moved:]
        centres_nm = error_nm.reshape(lines, line).mean(axis=1)
        drift_nm[scheme] = abs(centres_nm[-1] - centres_nm[0])
        rms_nm[scheme] = np.sqrt(np.mean(error_nm**2))
    assert drift_nm['fbff'] < 0.1
    assert rms_nm['fbff'] < 1.0
    assert drift_nm['ff'] > 50.0
