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

"""The block of a paced plant: taken when it comes, answered when its time has come."""

import time

import numpy as np
from numpy.typing import NDArray

from piezo_ros.nodes.plant_parts.pace import Pace
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['PacedBlock']

_NAP_S = 0.005  # the node sleeps so long at once, and then looks whether it shall stop


class PacedBlock:
    """
    Gives out each block of a stream once its answer is due.

    Parameters
    ----------
    reader : StreamReader
        The stream; a run has begun on it.
    pace : Pace
        The schedule of the answers.

    """

    def __init__(self, reader: StreamReader, pace: Pace) -> None:
        self._reader = reader
        self._pace = pace
        self._block: NDArray[np.float64] | None = None
        self._due_s = 0.0

    @property
    def is_waiting(self) -> bool:
        """Whether a block has come that is not due yet."""
        return self._block is not None

    @property
    def overruns(self) -> int:
        """Number of blocks so far that came too late."""
        return self._pace.overruns

    def take(self, index: int) -> NDArray[np.float64] | None:
        """
        Return a block that is due, None where there is none; sleep for a moment if that helps.

        Parameters
        ----------
        index : int
            Index of the newest answer.

        Returns
        -------
        ndarray of float64, shape (N,), or None
            Its samples; none at all are the end of the stream.

        """
        if self._block is None:
            self._block = self._reader.take_array()
            if self._block is None:
                return None
            self._due_s = self._pace.due_s(index, len(self._block), time.monotonic())
        left_s = self._due_s - time.monotonic()
        if left_s > 0.0 and self._block.size:
            # All nodes wait for this one; none has to wait for longer than a nap.
            time.sleep(min(left_s, _NAP_S))
            if left_s > _NAP_S:
                return None
        block, self._block = self._block, None
        return block
