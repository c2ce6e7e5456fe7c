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

"""A time limit counts the time in which the process could run."""

from piezo_ros.runtime.process import running_time
from piezo_ros.runtime.process.running_time import LONGEST_LOOK_S, RunningTime


def test_a_standstill_counts_for_one_look(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(running_time.time, 'monotonic', lambda: now_s[0])
    waited = RunningTime()
    for _ in range(10):
        now_s[0] += 0.1
        elapsed_s = waited.elapsed_s()
    assert abs(elapsed_s - 1.0) < 1e-9
    now_s[0] += 3600.0
    assert abs(waited.elapsed_s() - 1.0 - LONGEST_LOOK_S) < 1e-9
    waited.restart()
    now_s[0] += 0.2
    assert abs(waited.elapsed_s() - 0.2) < 1e-9
