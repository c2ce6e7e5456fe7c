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

import pytest

from piezo_ros.runtime.process import running_time
from piezo_ros.runtime.process.running_time import (
    LONGEST_LOOK_S,
    RunningTime,
    busy_words,
    crowding,
)


def test_a_standstill_counts_for_one_look(clock):
    waited = RunningTime()
    assert clock.run(1.0, waited.elapsed_s) == pytest.approx(1.0)
    clock.advance(3600.0)
    assert waited.elapsed_s() == pytest.approx(1.0 + LONGEST_LOOK_S)
    waited.restart()
    clock.advance(0.2)
    assert waited.elapsed_s() == pytest.approx(0.2)


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Make a machine of two processors so busy that it says a line."""
    def say(line):
        file = tmp_path / 'loadavg'
        file.write_text(line)
        monkeypatch.setattr(running_time, '_LOADAVG', file)
        monkeypatch.setattr(running_time, '_PROCESSORS', 2)

    return say


def test_a14_a_time_limit_goes_slower_on_a_busy_machine(monkeypatch, machine):
    now_s = [100.0]
    monkeypatch.setattr(running_time.time, 'monotonic', lambda: now_s[0])
    waited = RunningTime()
    machine('31.05 20.00 9.00 32/812 4711')
    for _ in range(16):
        now_s[0] += 0.2
        elapsed_s = waited.elapsed_s()
    assert elapsed_s == pytest.approx(0.2)
    assert waited.awake_s == pytest.approx(3.2)
    assert busy_words() == '; the machine is busy: 32 threads want to run on 2 processors'
    machine('0.10 20.00 9.00 1/812 4711')
    now_s[0] += 0.2
    assert waited.elapsed_s() == pytest.approx(0.4)
    assert busy_words() == ''


@pytest.mark.parametrize('line', ['', 'nonsense', '1 2 3 4', '1 2 3 x/y 5'])
def test_where_the_system_does_not_tell_the_wall_clock_counts(machine, line):
    machine(line)
    assert crowding() == 1.0
    running_time._LOADAVG.unlink()
    assert crowding() == 1.0
