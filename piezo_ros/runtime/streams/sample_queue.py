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

"""Samples that wait to be used, one by one or many at once."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['SampleQueue']

_LEAST_ROOM: Final = 4096  # samples


class SampleQueue:
    """
    First in, first out; what waits lies in one piece.

    Samples are handed out where they lie, and never written over, whatever comes and goes.
    """

    def __init__(self) -> None:
        self._samples = np.empty(_LEAST_ROOM)
        self._first = self._end = 0

    def __len__(self) -> int:
        """Return the number of samples that wait."""
        return self._end - self._first

    def append(self, sample: float) -> None:
        """Add a sample."""
        if self._end == self._samples.size:
            self._make_room(1)
        self._samples[self._end] = sample
        self._end += 1

    def extend(self, samples: Sequence[float] | NDArray[np.float64]) -> None:
        """Add samples."""
        end = self._end + len(samples)
        if end > self._samples.size:
            self._make_room(len(samples))
            end = self._end + len(samples)
        self._samples[self._end:end] = samples
        self._end = end

    def join(self, blocks: Sequence[NDArray[np.float64]]) -> None:
        """Add the samples of blocks, at least one, by a single copy."""
        self._samples = np.concatenate([self.waiting, *blocks] if self else blocks)
        self._first, self._end = 0, self._samples.size

    def popleft(self) -> float:
        """
        Return the oldest sample, which waits no more.

        Raises
        ------
        IndexError
            If no sample waits.

        """
        if self._first == self._end:
            raise IndexError('no sample waits')
        sample: float = self._samples.item(self._first)
        self._first += 1
        return sample

    def pull(self, count: int) -> NDArray[np.float64]:
        """Return the oldest samples, at most those that wait, which wait no more."""
        first, self._first = self._first, min(self._first + count, self._end)
        return self._samples[first:self._first]

    @property
    def waiting(self) -> NDArray[np.float64]:
        """The samples that wait, shape (N,); they go on waiting."""
        return self._samples[self._first:self._end]

    def drop(self, count: int) -> None:
        """Throw the oldest samples away, at most those that wait."""
        self._first = min(self._first + count, self._end)

    def clear(self) -> None:
        """Throw all samples away."""
        self._first = self._end

    def _make_room(self, count: int) -> None:
        """Move what waits to where there is room for more of it."""
        waiting = self._samples[self._first:self._end]
        # Elsewhere, for a part may be in use; and twice as much, so that it is not moved for each.
        self._samples = np.empty(max(_LEAST_ROOM, 2 * (waiting.size + count)))
        self._samples[:waiting.size] = waiting
        self._first, self._end = 0, waiting.size
