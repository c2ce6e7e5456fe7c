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
One run out of a bag that has several, as a recorder leaves that goes on while runs begin anew.

Each stream ends a run with a block without samples; what follows belongs to the next run.
"""

from collections import Counter
from collections.abc import Collection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.container.mcap_file import Piece
from piezo_ros.bag.samples.block_arrays import decoded
from piezo_ros.streams import BlockCodec

__all__ = ['RunChoice']


class RunChoice:
    """
    The messages of one run, while the pieces of a bag are read in their order.

    Parameters
    ----------
    number : int
        Which run, counted from 1.

    Raises
    ------
    BagError
        If there can be no run of that number.

    """

    def __init__(self, number: int) -> None:
        if number < 1:
            raise BagError(f'run is {number}, runs are counted from 1')
        self._number = number
        self._ends: Counter[str] = Counter()
        self._goes_on: dict[str, bool] = {}  # whether messages follow the last end of a topic
        self._chosen: dict[tuple[Path, int, str], slice] = {}

    def choose(
        self, path: Path, piece: Piece, topic: str, stream: str, messages: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """
        Return those messages of a topic in the next piece that belong to the run.

        Parameters
        ----------
        path, piece : Path, Piece
            The file, and the next piece of it.
        topic, stream : str
            The topic, and the stream on it.
        messages : ndarray of int64
            Offsets of all messages of the topic in the piece.

        """
        blocks, _ = decoded(BlockCodec(stream), piece.data, messages)
        ends = np.zeros(messages.size, dtype=np.int64)  # what does not decode ends nothing
        ends[:blocks.counts.size] = blocks.counts == 0
        runs = self._ends[topic] + np.cumsum(ends) - ends
        self._ends[topic] += int(ends.sum())
        self._goes_on[topic] = not ends[-1]
        first, stop = np.searchsorted(runs, (self._number - 1, self._number)).tolist()
        self._chosen[path, piece.position, topic] = slice(first, stop)
        return messages[first:stop]

    def choose_again(
        self, path: Path, piece: Piece, topic: str, messages: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the same messages of a piece that is read once more, in whatever order."""
        return messages[self._chosen[path, piece.position, topic]]

    def check(self, path: Path, topics: Collection[str]) -> None:
        """
        Check that all streams of a rig tell the same number of runs, so that theirs are the same.

        Raises
        ------
        BagError
            If they do not, or the run is not among them.

        """
        ends = {topic: self._ends[topic] for topic in sorted(topics)}
        runs = {topic: count + self._goes_on[topic] for topic, count in ends.items()}
        if len(set(runs.values())) > 1:
            told = ', '.join(f'{topic} {count}' for topic, count in runs.items())
            raise BagError(
                f'{path}: the streams have different numbers of runs, so that it is not certain '
                f'which belong together: {told}')
        number = max(runs.values(), default=0)
        if self._number > number:
            raise BagError(f'{path} has no run {self._number}, its streams have {number}')
