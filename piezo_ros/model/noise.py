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
Measurement noise as a function of the seed and the sample's index alone.

A counter-based generator (Philox) starts afresh at every 4096th index::

    noise[k] = normal(key = seed, counter = (0, k // 4096, 0, 0))[k mod 4096]

So a sample has the same noise live, one by one, and offline, all at once.
"""

import threading
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ['NoiseSource', 'unit_noise']

_CHUNK = 4096


class _Generator(threading.local):
    """One for all seeds, in each thread: to make another one takes half as long as to draw."""

    def __init__(self) -> None:
        self._bits = np.random.Philox(key=0)
        self._fresh: Any = self._bits.state
        self._generator = np.random.Generator(self._bits)

    def chunk(self, seed: int, number: int) -> NDArray[np.float64]:
        """Return the noise of one chunk of a seed, shape (4096,)."""
        state: Any = {**self._fresh, 'state': {
            'counter': np.array([0, number, 0, 0], np.uint64),
            'key': np.array([seed, 0], np.uint64)}}
        self._bits.state = state
        return self._generator.standard_normal(_CHUNK)


_generator = _Generator()


@lru_cache(maxsize=8)  # rigs that differ in other things than the seed have the same noise
def _chunk(seed: int, number: int) -> NDArray[np.float64]:
    """Return the noise of one chunk, not to be changed: it is shared."""
    noise = _generator.chunk(seed, number)
    noise.setflags(write=False)
    return noise


def unit_noise(seed: int, start: int, count: int) -> NDArray[np.float64]:
    """
    Return white Gaussian noise of unit variance.

    Parameters
    ----------
    seed : int
        Seed, 0 … 2**63 - 1.
    start : int
        Index of the first sample.
    count : int
        Number of samples.

    Returns
    -------
    ndarray, shape (count,)
        The noise of the samples start … start + count - 1.

    Examples
    --------
    >>> whole = unit_noise(seed=7, start=0, count=5000)
    >>> part = unit_noise(seed=7, start=4090, count=10)
    >>> bool((part == whole[4090:4100]).all())
    True

    """
    noise = np.empty(max(count, 0))
    done = 0
    while done < count:
        number, at = divmod(start + done, _CHUNK)
        part = _chunk(seed, number)[at:at + count - done]
        noise[done:done + part.size] = part
        done += part.size
    return noise


class NoiseSource:
    """`unit_noise` one sample at a time, for a node."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._start = 0
        self._values: list[float] = []
        self._window: tuple[int, NDArray[np.float64]] = (0, np.empty(0))

    def __call__(self, index: int) -> float:
        """Return the noise of one sample."""
        offset = index - self._start
        if not 0 <= offset < len(self._values):
            self._start = index - index % _CHUNK
            self._values = _chunk(self._seed, index // _CHUNK).tolist()
            offset = index - self._start
        return self._values[offset]

    def window(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """Return the noise of the chunk that has a sample, and the index of its first."""
        first, values = self._window
        if not first <= index < first + values.size:
            number = index // _CHUNK
            # A copy: compiled code takes an array that may be changed for another type.
            self._window = first, values = number * _CHUNK, _chunk(self._seed, number).copy()
        return first, values

    def block(self, start: int, count: int) -> NDArray[np.float64]:
        """Return the noise of consecutive samples, shape (count,)."""
        return unit_noise(self._seed, start, count)
