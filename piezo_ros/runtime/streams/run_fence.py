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

"""
What keeps the rest of an interrupted run of a stream out of the next run.

Messages carry no name of their run, and the node that stops first still has samples of the others
on their way. But every run of a stream is one contiguous sequence that ends with an end marker:
what goes on where the interrupted run was left is of that run, up to its end marker. A node waits,
when it is deactivated, until its readers have this marker.
"""

from collections import deque
from collections.abc import Callable

__all__ = ['RunFence']


class RunFence:
    """
    Sorts the messages of one stream between two runs.

    Parameters
    ----------
    take : callable
        Returns the next message, None where there is none.
    extent : callable
        Returns index and number of samples of a message; raises ValueError if it is malformed.

    Attributes
    ----------
    held : deque of bytes
        Messages of the run to come that were taken already.

    """

    def __init__(
        self, take: Callable[[], bytes | None], extent: Callable[[bytes], tuple[int, int]],
    ) -> None:
        self.held: deque[bytes] = deque()
        self._take = take
        self._extent = extent
        self._is_open = False  # the end of an earlier run has not come
        self._rest_at: int | None = None  # index where that goes on, None where it had no sample

    def interrupt(self, next_index: int | None) -> None:
        """
        Remember that a run was left before its end marker came.

        Parameters
        ----------
        next_index : int or None
            Index of the sample that would have come next; None where none had come, and nothing is
            known of where that run is.

        """
        if next_index is not None or not self._is_open:
            self._rest_at = next_index
        self._is_open = True

    def discard_rest(self) -> None:
        """Throw away what comes of the interrupted run, while no run goes on."""
        while self._is_open and self._rest_at is not None:
            message = self._take()
            if message is None:
                return
            if not self._is_rest_message(message):
                self.held.append(message)

    def begin(self, *, takes_any_start: bool) -> None:
        """
        Throw away what has come of the interrupted run, at the beginning of the next.

        Parameters
        ----------
        takes_any_start : bool
            Whether the run may begin at any index. It may be that of a source that went on
            meanwhile, and only what has come by now is of the past.

        """
        self.discard_rest()
        if self._is_open and self._rest_at is None:
            self._discard_to_first_end()
        if takes_any_start:
            self._is_open = False

    def is_rest(self, index: int, samples: int) -> bool:
        """Return whether a block is of the interrupted run; nothing of a new one has come yet."""
        if not self._is_open or index != self._rest_at:
            self._is_open = False
            return False
        self._rest_at += samples
        self._is_open = samples > 0
        return True

    def _is_rest_message(self, message: bytes) -> bool:
        try:
            return self.is_rest(*self._extent(message))
        except ValueError:
            return True  # No run has use for it.

    def _discard_to_first_end(self) -> None:
        """Throw away what begins with a run of which nothing had come, if its end is here."""
        while (message := self._take()) is not None:
            self.held.append(message)
        for number, message in enumerate(self.held):
            try:
                is_end = self._extent(message)[1] == 0
            except ValueError:
                continue
            if is_end:
                for _ in range(number + 1):
                    self.held.popleft()
                break
        self._is_open = False
