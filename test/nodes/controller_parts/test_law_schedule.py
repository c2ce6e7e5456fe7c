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

"""Changes of gains and scheme by index: the listed ones, and those that a call asks for."""

import pytest

from piezo_ros.control import ControllerParameters
from piezo_ros.control.changes import ChangeParameters
from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.controller_parts.change_request import ChangeRequest
from piezo_ros.nodes.controller_parts.law_schedule import LawSchedule

LAW = ControllerParameters(scheme='fb')


@pytest.fixture
def schedule():
    return LawSchedule.listed(LAW, ChangeParameters(
        changes='[{"at_sample": 20, "scheme": "ff"}, {"at_sample": 40, "scheme": "fb"}]'))


def ask(schedule, next_index=10, first=0, unfed_topic='', **changes):
    """Ask for a change during a run; return why it is refused."""
    return ChangeRequest.among(changes).add_to(
        schedule, next_index=next_index, first=first, unfed_topic=unfed_topic)


def test_listed_changes_come_one_after_the_other(schedule):
    assert schedule.samples_before_change(5) == 15
    assert schedule.samples_before_change(20) > 10**9  # it is due
    schedule.apply()
    assert (schedule.law.scheme, schedule.changed_at, schedule.change_at) == ('ff', 20, 40)
    schedule.apply()
    assert (schedule.law.scheme, schedule.changed_at) == ('fb', 40)
    assert schedule.samples_before_change(50) > 10**9  # there is none


def test_a_call_counts_as_the_streams_do_and_the_next_run_forgets_it(schedule):
    assert ask(schedule, next_index=110, first=100, proportional_gain=0.7) == ''
    assert schedule.change_at == 10
    assert ask(schedule, next_index=110, first=100, proportional_gain=0.8,
               apply_at_sample=120) == ''
    assert [law.proportional_gain for law in schedule.laws()[1:]] == [0.7, 0.8, 0.8]
    schedule.apply()
    schedule.restart()
    assert (schedule.law, schedule.changed_at, schedule.change_at) == (LAW, None, 20)


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'proportional_gain': 0.7, 'apply_at_sample': 9},
     'apply_at_sample is 9; the next sample is 10 already'),
    ({'scheme': 'fbff', 'unfed_topic': '/rig/feedforward'},
     "scheme is 'fbff', and /rig/feedforward has no writer"),
    ({'scheme': 'auto'}, 'scheme is auto'),
])
def test_a_refusal_leaves_the_schedule_alone(schedule, changes, reason):
    assert ask(schedule, **changes).startswith(reason)
    assert [law.scheme for law in schedule.laws()] == ['fb', 'ff', 'fb']


def test_a_sample_of_a_run_that_has_not_joined_its_streams_is_refused(schedule):
    assert ask(schedule, next_index=0, first=None, proportional_gain=0.7, apply_at_sample=5) == (
        'apply_at_sample is 5; at which sample the run begins is not known yet (start_index -1); '
        'call again once commands are sent')
    assert schedule.change_at == 20
    assert ask(schedule, next_index=0, first=None, proportional_gain=0.7) == ''
    assert schedule.change_at == 0  # its first sample


def test_a_sample_without_gains_is_refused():
    request = ChangeRequest.among({'apply_at_sample': 7, 'block_samples': 5})
    assert not request.values
    assert request.refusal_without_run.startswith('apply_at_sample is 7; it goes with gains')
    assert ChangeRequest.among({'scheme': 'ff'}).refusal_without_run == ''


def test_a_sample_for_a_call_is_no_listed_change():
    with pytest.raises(ParameterError, match='apply_at_sample is 3; it belongs to a change during'):
        LawSchedule.listed(LAW, ChangeParameters(apply_at_sample=3))
