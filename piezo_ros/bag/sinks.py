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

"""Sinks, which take the samples of a stream while a bag is read."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ['Collected', 'Extremes', 'Sink']

# Is called with the index of the first sample and the samples, part by part without a gap.
Sink = Callable[[int, NDArray[np.float64]], None]


class Collected:
    """
    A sink that keeps samples.

    Parameters
    ----------
    kept : range, optional
        Indices of the samples to keep; all by default.

    """

    def __init__(self, kept: range | None = None) -> None:
        self._kept = kept
        # Most often grows without being copied, other than an array.
        self._bytes = bytearray()

    def __call__(self, index: int, samples: NDArray[np.float64]) -> None:
        """Keep those of some samples that are wanted."""
        if self._kept is not None:
            kept = self._kept
            first = max(kept.start, index)
            first += (kept.start - first) % kept.step
            samples = samples[first - index:max(kept.stop - index, 0):kept.step]
        self._bytes += np.ascontiguousarray(samples).data

    def samples(self) -> NDArray[np.float64]:
        """Return the samples that were kept; no more can be added afterwards."""
        return np.frombuffer(self._bytes, dtype=np.float64)


class Extremes:
    """A sink that keeps the smallest and the largest sample."""

    def __init__(self) -> None:
        self.minimum = np.inf
        self.maximum = -np.inf

    def __call__(self, index: int, samples: NDArray[np.float64]) -> None:
        """Compare some samples with those before."""
        self.minimum = min(self.minimum, float(np.fmin.reduce(samples)))
        self.maximum = max(self.maximum, float(np.fmax.reduce(samples)))
