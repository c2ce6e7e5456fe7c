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

"""The pace of a run on the wall clock: when each answer is due, and which come too late."""

__all__ = ['Pace']


class Pace:
    """
    A schedule of answers, one each sample period times some factor.

    An answer to a question that comes after it was due is an overrun. The schedule then begins anew
    from there: what was lost is not made up for by a burst.

    Parameters
    ----------
    realtime_factor : float
        Simulated seconds per second of the clock.
    sample_period_s : float
        Sample period, simulated seconds.

    Attributes
    ----------
    overruns : int
        Number of questions so far that came too late.

    """

    def __init__(self, realtime_factor: float, sample_period_s: float) -> None:
        self._period_s = sample_period_s / realtime_factor
        self._origin: tuple[int, float] | None = None
        self.overruns = 0

    def due_s(self, index: int, count: int, now_s: float) -> float:
        """
        Return when the answer to a question is due that has come now.

        Parameters
        ----------
        index : int
            Index of its first sample.
        count : int
            Number of its samples; the answer ends that many periods after it began.
        now_s : float
            Time on a steady clock, seconds.

        """
        if self._origin is None:
            self._origin = index, now_s
        since, origin_s = self._origin
        due_s = origin_s + (index + count - since) * self._period_s
        if now_s > due_s:
            self.overruns += 1
            self._origin = index + count, now_s
            return now_s
        return due_s
