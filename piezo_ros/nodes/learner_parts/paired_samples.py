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

"""The samples of two streams, paired by their index."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ['PairedSamples']

_Floats = NDArray[np.float64]


class PairedSamples:
    """
    Keeps what has come of two streams until the other one has come as far.

    Samples before the first one that both have are left out.
    """

    def __init__(self) -> None:
        self._waiting: tuple[list[tuple[int, _Floats]], list[tuple[int, _Floats]]] = ([], [])

    def add(self, which: int, first: int, samples: _Floats) -> None:
        """
        Take a block of a stream.

        Parameters
        ----------
        which : int
            0 or 1, the stream.
        first : int
            Index of the first sample.
        samples : ndarray, shape (N,)
            The samples, N above 0.

        """
        self._waiting[which].append((first, samples))

    def take(self) -> Iterator[tuple[int, _Floats, _Floats]]:
        """Yield the index of the first sample, and the samples of both streams from there on."""
        one, other = self._waiting
        while one and other:
            first = max(one[0][0], other[0][0])
            end = min(start + part.size for start, part in (one[0], other[0]))
            pair = []
            for waiting in self._waiting:
                start, part = waiting.pop(0)
                pair.append(part[first - start:end - start] if end > first else part[:0])
                rest = part[max(end - start, 0):]
                if rest.size:
                    waiting.insert(0, (start + part.size - rest.size, rest))
            if end > first:
                yield first, pair[0], pair[1]
