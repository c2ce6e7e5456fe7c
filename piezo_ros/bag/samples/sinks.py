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
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['Collected', 'Extremes', 'Sink']

# Is called with the index of the first sample and the samples, part by part without a gap.
Sink = Callable[[int, NDArray[np.float64]], None]
# From 4 MB on NumPy asks the system for large pages; to fill memory that comes in small ones takes
# as long as to decompress what goes into it. What is not filled takes no memory.
_FIRST_SAMPLES: Final = (4 << 20) // 8


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
        self._samples: NDArray[np.float64] = np.empty(_FIRST_SAMPLES)
        self._count = 0

    def __call__(self, index: int, samples: NDArray[np.float64]) -> None:
        """Keep those of some samples that are wanted."""
        if self._kept is not None:
            kept = self._kept
            first = max(kept.start, index)
            first += (kept.start - first) % kept.step
            samples = samples[first - index:max(kept.stop - index, 0):kept.step]
        end = self._count + samples.size
        if end > self._samples.size:
            before = self._samples[:self._count]
            # Room that is never written takes no memory, to move the samples takes time.
            self._samples = np.empty(max(end, 4 * before.size))
            self._samples[:before.size] = before
        self._samples[self._count:end] = samples
        self._count = end

    def samples(self) -> NDArray[np.float64]:
        """Return the samples that were kept; no more can be added afterwards."""
        return self._samples[:self._count]


class Extremes:
    """A sink that keeps the smallest and the largest sample."""

    def __init__(self) -> None:
        self.minimum = np.inf
        self.maximum = -np.inf

    def __call__(self, index: int, samples: NDArray[np.float64]) -> None:
        """Compare some samples with those before."""
        self.minimum = min(self.minimum, float(np.fmin.reduce(samples)))
        self.maximum = max(self.maximum, float(np.fmax.reduce(samples)))
