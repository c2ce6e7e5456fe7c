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
"""What one thread wants done by another: done, refused, or taken back."""

import threading

import pytest

from piezo_ros.runtime.node.rclpy_node.thread_request import ServiceRefusedError, ThreadRequest


def test_an_error_of_the_action_reaches_the_thread_that_asked():
    def fail():
        raise ZeroDivisionError('by zero')

    request = ThreadRequest(fail)
    request.serve()
    with pytest.raises(ZeroDivisionError, match='by zero'):
        request.wait_unless(str)


def test_a_request_that_is_taken_back_is_never_done():
    done = []
    request = ThreadRequest(lambda: done.append(True))
    with pytest.raises(ServiceRefusedError, match='a reader does not take'):
        request.wait_unless(lambda: 'a reader does not take')
    request.serve()
    assert not done


def test_a_request_that_is_being_served_is_not_taken_back():
    began, goes_on = threading.Event(), threading.Event()

    def act():
        began.set()
        goes_on.wait(30.0)

    request = ThreadRequest(act)
    thread = threading.Thread(target=request.serve)
    thread.start()
    assert began.wait(30.0)

    def refusal():
        goes_on.set()
        return 'a reader does not take'

    request.wait_unless(refusal)
    thread.join()
