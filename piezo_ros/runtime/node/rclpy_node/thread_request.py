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

"""An action that one thread wants done by another."""

import threading
from collections.abc import Callable

__all__ = ['ServiceRefusedError', 'ThreadRequest']

_LOOK_S = 0.2  # between two looks whether something speaks against a request


class ServiceRefusedError(Exception):
    """What a service was asked for does not go now; the text says why."""


class ThreadRequest:
    """
    Hands an action to another thread, and the exception that it raises back to the first.

    Parameters
    ----------
    action : callable
        What is to be done.

    """

    def __init__(self, action: Callable[[], None]) -> None:
        self._action = action
        self._done = threading.Event()
        self._turn = threading.Lock()  # of the thread that serves it, or of the one that withdraws
        self._error: Exception | None = None

    def serve(self) -> None:
        """Do the action, in the thread that it is meant for, unless it was withdrawn."""
        if not self._turn.acquire(blocking=False):
            return
        try:
            self._action()
        except Exception as error:
            self._error = error
        finally:
            self._done.set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait in the other thread, at most so long; return whether it is done; raise its error."""
        is_done = self._done.wait(timeout_s)
        if self._error is not None:
            raise self._error
        return is_done

    def wait_unless(self, refusal: Callable[[], str]) -> None:
        """
        Wait in the other thread until it is done, or until something speaks against it.

        Parameters
        ----------
        refusal : callable
            Returns why the request is taken back, '' as long as it is not; asked now and then.

        Raises
        ------
        ServiceRefusedError
            If it was taken back. It is not done then.

        """
        while not self.wait(_LOOK_S):
            if (why := refusal()) and self._turn.acquire(blocking=False):
                raise ServiceRefusedError(why)
