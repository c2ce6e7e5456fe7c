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
from types import SimpleNamespace

import numpy as np
import pytest

from piezo_ros.report.amplifier_use import AmplifierLimits
from piezo_ros.report.figures.voltage_figure import limited_voltage, voltage_figure, voltage_title
from piezo_ros.report.page.run_charts import starts_of, tracking_panels, voltage_panels
from piezo_ros.report.run_setup import RunSetup, run_setup

LIMITS = AmplifierLimits(-1.0, 50.0, 2e5, 0.0, 5.0)
METADATA = """\
rosbag2_bagfile_information:
  starting_time:
    nanoseconds_since_epoch: {}
"""


def bag(path, text, **controller):
    path.mkdir()
    (path / 'metadata.yaml').write_text(text)
    parameters = {'controller': {'kind': 'controller', **controller}}
    return SimpleNamespace(path=path, parameters=parameters)


@pytest.fixture
def limited_run(scored_runs):
    run = scored_runs[1]
    return dataclasses.replace(
        run, setup=RunSetup(limits=LIMITS), voltage_v=np.clip(1.2 * run.reference_um, -1.5, 3.0))


def test_gains_and_date_of_a_bag_are_told(tmp_path):
    run = bag(tmp_path / 'live', METADATA.format(1_700_000_000_000_000_000),
              proportional_gain=0.25, integral_gain_per_s=2630.0, changes='')
    found = run_setup(run, 'fbff')
    assert (found.proportional_gain, found.integral_gain_per_s) == (0.25, 2630.0)
    assert found.recorded == '2023-11-14 22:13:20'
    assert run_setup(run, 'ff').proportional_gain is None  # it has no feedback


@pytest.mark.parametrize('text', [
    METADATA.format(0), METADATA.format('soon'), METADATA.format(10**30), '[', 'a: 1', ''])
def test_what_a_bag_does_not_tell_is_left_out(tmp_path, text):
    found = run_setup(bag(tmp_path / 'foreign', text, proportional_gain='high'), 'fb')
    assert found == RunSetup()


def test_samples_at_the_rail_are_marked_and_a_far_rail_is_told_in_words(limited_run):
    limited = limited_voltage(limited_run)
    beyond = limited_run.voltage_v < LIMITS.minimum_v - 0.01
    assert np.isfinite(limited.at_rails_v)[beyond].all()
    assert np.isnan(limited.at_rails_v)[limited_run.voltage_v > LIMITS.minimum_v + 0.01].all()
    assert limited.rails_v == (-1.0,)
    title = voltage_title(limited_run, [limited_run])
    assert title == 'FF: −1.5 … 2.4 V, rails −1 and 50 V, slew limit 200 V/ms'
    (row,) = voltage_figure([limited_run]).axes
    assert 'at a rail' in row.get_legend_handles_labels()[1]
    (panel,) = voltage_panels([limited_run])
    assert [line.value for line in panel.lines] == [-1.0]
    assert [trace.label for trace in panel.traces] == ['FF', 'at a rail']


def test_an_amplifier_that_is_not_known_limits_nothing_and_this_is_told(scored_runs):
    limited = limited_voltage(scored_runs[1])
    assert np.isnan(limited.slewing_v).all()
    assert limited.rails_v == ()
    assert 'not known' in voltage_title(scored_runs[1], scored_runs)


def test_the_transient_is_the_first_periods_of_a_run(scored_runs):
    starts = starts_of(scored_runs)
    assert len(starts) == len(scored_runs)
    assert starts[1].window_ms[-1] == pytest.approx(4 / 0.3, abs=0.02)
    assert starts[1].time_s[0] == 0.0
    assert starts[1].max_error_um == pytest.approx(np.abs(starts[1].error_um).max())
    top, bottom = tracking_panels(starts[:3])
    assert [trace.label for trace in top.traces] == ['desired', 'FB', 'FF', 'FBFF']
    assert len(bottom.traces) == 3
