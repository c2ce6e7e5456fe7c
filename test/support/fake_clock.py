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


class FakeClock:
    """Monotonic time in ``now_s``, from 100 s on."""

    def __init__(self):
        self.now_s = 100.0

    def advance(self, duration_s):
        self.now_s += duration_s

    def run(self, duration_s, look, step_s=0.1):
        """Advance in steps and call a function after each; return what it has returned last."""
        result = None
        for _ in range(round(duration_s / step_s)):
            self.advance(step_s)
            result = look()
        return result


@pytest.fixture
def clock(monkeypatch):
    """Replace `time.monotonic` and `time.sleep`."""
    fake = FakeClock()
    monkeypatch.setattr(time, 'monotonic', lambda: fake.now_s)
    monkeypatch.setattr(time, 'sleep', fake.advance)
    return fake
