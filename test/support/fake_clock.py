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

"""A clock that stands still unless the code under test sleeps or the test advances it."""

import time

import pytest

from piezo_ros.runtime.process import running_time


class FakeClock:
    """Monotonic time in ``now_s``, from 100 s on."""

    def __init__(self):
        self.now_s = 100.0
        self._planned = []

    def advance(self, duration_s):
        self.now_s += duration_s
        while self._planned and self._planned[0][0] <= self.now_s:
            self._planned.pop(0)[1]()

    def plan(self, after_s, action):
        """Call a function once so much time has passed."""
        self._planned.append((self.now_s + after_s, action))
        self._planned.sort(key=lambda planned: planned[0])

    def run(self, duration_s, look, step_s=0.1):
        """Advance in steps and call a function after each; return what it has returned last."""
        result = None
        for _ in range(round(duration_s / step_s)):
            self.advance(step_s)
            result = look()
        return result


@pytest.fixture
def clock(monkeypatch):
    """Replace `time.monotonic` and `time.sleep`, on a machine that is not busy."""
    fake = FakeClock()
    monkeypatch.setattr(running_time, 'crowding', lambda: 1.0)
    monkeypatch.setattr(time, 'monotonic', lambda: fake.now_s)
    monkeypatch.setattr(time, 'sleep', fake.advance)
    return fake
