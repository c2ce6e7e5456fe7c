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

"""The schedule of a paced run; its clock is an argument."""

from piezo_ros.nodes.plant_parts.pace import Pace


def test_answers_are_due_one_period_after_each_other_whenever_the_question_came():
    pace = Pace(0.5, 1.0)
    assert pace.due_s(0, 1, 100.0) == 102.0
    assert pace.due_s(1, 1, 102.5) == 104.0
    assert pace.due_s(2, 1, 103.9999) == 106.0
    assert pace.due_s(3, 10, 106.0) == 126.0
    assert pace.overruns == 0


def test_an_overrun_is_counted_and_not_made_up_for():
    pace = Pace(1.0, 1.0)
    assert pace.due_s(7, 1, 10.0) == 11.0
    assert pace.due_s(8, 1, 15.0) == 15.0  # was due at 12
    assert pace.overruns == 1
    assert pace.due_s(9, 1, 15.1) == 16.0
    assert pace.due_s(10, 1, 16.5) == 17.0
    assert pace.overruns == 1
