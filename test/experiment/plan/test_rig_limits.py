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

"""What a plan asks of its rig before anything is driven."""

import pytest
import yaml

from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.rig_limits import check_plan
from piezo_ros.parameters.errors import PlanError


@pytest.fixture
def demand(tmp_path):
    """Return what one run asks of the rig."""
    def check(**run):
        path = tmp_path / 'plan.yaml'
        path.write_text(yaml.safe_dump(
            {'format_version': 1, 'score_periods': 1, 'runs': [{'periods': 3, **run}]}))
        (found,) = check_plan(read_plan(path))
        return found

    return check


def test_a_run_within_every_limit_is_fine(demand):
    found = demand(scheme='fbff')
    assert not found.beyond
    assert 0.8 < found.highest_um < 1.1
    assert found.travel_um == 6.0
    assert found.rails_v == (-7.0, 5.0)
    assert -2.0 < found.lowest_v < -0.5
    assert 0.5 < found.highest_v < 2.0
    assert 'BEYOND' not in found.text


def test_a_voltage_beyond_a_rail_is_counted(demand):
    found = demand(
        scheme='ff', amplitude_um=2.5, plant={'voltage_maximum_v': 6.0})
    assert found.beyond
    assert found.highest_v > 1.0 == found.rails_v[1]
    assert found.limited_rails > 50
    assert f'BEYOND in {found.limited_rails} samples' in found.text


def test_a_slew_beyond_the_limit_counts_where_it_is_scored(demand):
    limit_v_per_s = demand(scheme='ff').slew_v_per_s / 2.0
    found = demand(scheme='ff', plant={'slew_limit_v_per_s': limit_v_per_s})
    assert found.limited_scored > 50
    assert found.limited_before > 2 * found.limited_scored - 10
    assert found.beyond


def test_an_abrupt_start_alone_is_told_and_no_fault(demand):
    found = demand(scheme='ff', plant={'slew_limit_v_per_s': 18200.0})
    assert found.limited_before >= 1
    assert not found.beyond
    assert 'ramp_periods' in found.text


def test_the_bare_actuator_is_checked_by_its_voltage(demand):
    found = demand(output='voltage', amplitude_v=3.0, harmonics=0)
    assert found.highest_v == pytest.approx(3.0, rel=0.02)
    assert not found.beyond


def test_a_study_cannot_be_checked(tmp_path):
    path = tmp_path / 'study.yaml'
    path.write_text('{format_version: 1, study: paper}')
    with pytest.raises(PlanError, match='the study paper decides on its runs'):
        check_plan(read_plan(path))


def test_the_average_current_is_told_and_counts_where_it_is_scored(demand):
    asked = demand(scheme='ff').average_slew_v_per_s
    # A triangle asks for 4 A f of displacement, here over 1.28 um/V and more.
    assert 500.0 < asked < 1500.0
    found = demand(scheme='ff', plant={'average_slew_limit_v_per_s': 0.9 * asked})
    assert found.beyond
    assert f'average slew {asked / 1e3:.2f} V/ms' in demand(scheme='ff').text
    assert ': BEYOND' in found.text
    assert not demand(scheme='ff', plant={'average_slew_limit_v_per_s': 1.1 * asked}).beyond
