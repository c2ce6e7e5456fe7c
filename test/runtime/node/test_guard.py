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
"""Callbacks that never raise, and an executor that goes on whatever rclpy raises."""

from fake_transport import FakeTransport

from piezo_ros.runtime.node.rclpy_node.guard import spin_guarded


def test_a3_services_go_on_after_whatever_rclpy_raises(monkeypatch):
    monkeypatch.setattr('time.sleep', lambda seconds: None)
    outcomes = [ValueError('a time before 0'), None, OverflowError(), None]
    served = []

    class Executor:
        def spin_once(self, timeout_s):
            outcome = outcomes.pop(0)
            if outcome:
                raise outcome
            served.append(timeout_s)

    node = FakeTransport().owner()
    spin_guarded(Executor(), node, lambda: not outcomes)
    assert len(served) == 2
    first, second = node.logger.texts['error']
    assert 'a time before 0' in first
    assert 'OverflowError' in second
