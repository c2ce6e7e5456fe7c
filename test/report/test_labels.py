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

from piezo_ros.report.labels import run_label


def test_series_are_named_by_what_tells_them_apart(scored_runs):
    ff = scored_runs[1]
    more = dataclasses.replace(ff, harmonics=15)
    again = dataclasses.replace(ff, bag='bags/again')
    assert run_label(ff, scored_runs[:3]) == 'FF'
    assert run_label(more, [ff, more]) == 'FF, m = 15'
    assert run_label(again, [ff, again]) == 'FF, m = 9, bags/again'
