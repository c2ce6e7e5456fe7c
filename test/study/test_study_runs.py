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

"""The runs of a study, one after the other."""

from types import SimpleNamespace

from piezo_ros.study.study_runs import StudyRuns


def test_each_run_is_told_with_how_many_there_are(tmp_path):
    told = []
    runs = StudyRuns(
        tmp_path, lambda planned, bag: SimpleNamespace(wall_seconds=2.0), told.append, 2)
    for name in 'a', 'b', 'one_more':
        runs.one(SimpleNamespace(name=name, description='a scan'), tmp_path / 'bags' / name)
    assert told == ['[1/2] a: a scan', '[2/2] b: a scan', '[3/3] one_more: a scan']
    assert runs.wall_seconds == {'a': 2.0, 'b': 2.0, 'one_more': 2.0}
