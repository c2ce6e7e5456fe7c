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

"""Checks of one stream: whether its blocks are one contiguous sequence of samples."""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.block_arrays import Blocks, decoded
from piezo_ros.bag.container.mcap_file import Piece
from piezo_ros.bag.sinks import Sink
from piezo_ros.streams import BlockCodec
from piezo_ros.streams.block import MAXIMUM_INDEX

__all__ = ['StreamAssembler']


class StreamAssembler:
    """
    Check of the blocks of one stream, in the order of their recording; hands on their samples.

    Parameters
    ----------
    stream : str
        The stream.
    sink : callable
        Takes the samples, up to the first thing that is wrong.
    keep_not_finite : bool, optional
        Whether samples that are NaN or infinite are in order.

    Attributes
    ----------
    stream : str
        The stream.
    start_index : int
        Index of the first sample.
    sample_period_s : float
        Sample period, seconds; 0 before the first block.
    count : int
        How many samples were handed on.
    problem : str or None
        What is wrong with the sample that should follow; None if nothing is.

    """

    def __init__(self, stream: str, sink: Sink, *, keep_not_finite: bool = False) -> None:
        self.stream = stream
        self._sink = sink
        self._keep_not_finite = keep_not_finite
        self._codec = BlockCodec(stream)
        self._blocks = 0
        self._ended = False
        self.start_index = 0
        self.sample_period_s = 0.0
        self.count = 0
        self.problem: str | None = None

    def add(self, piece: Piece, messages: NDArray[np.int64]) -> None:
        """
        Take the blocks in a piece.

        Parameters
        ----------
        piece : Piece
            The piece.
        messages : ndarray of int64
            Offsets of the messages of this stream in it.

        """
        if self.problem is not None or not messages.size:
            return
        blocks, error = decoded(self._codec, piece.data, messages)
        malformed = None if error is None else (
            f'message {self._blocks + blocks.indices.size} of stream {self.stream!r}: {error}')
        if blocks.indices.size:
            self._hand_on(blocks)
        self.problem = self.problem or malformed

    def _hand_on(self, blocks: Blocks) -> None:
        """Hand on the samples of the blocks that are in order."""
        if not self._blocks:
            self.start_index = int(blocks.indices[0]) if np.isfinite(blocks.indices[0]) else 0
            self.sample_period_s = float(blocks.periods_s[0])
        good, self.problem = self._leading(blocks)
        samples = blocks.samples[:int(blocks.counts[:good].sum())]
        if not (self._keep_not_finite or (finite := np.isfinite(samples)).all()):
            first = int(np.argmin(finite))
            self.problem = (
                f'sample {self.start_index + self.count + first} of stream {self.stream!r} is '
                f'{samples[first]}, it must be finite')
            samples = samples[:first]
        self._blocks += good
        self._ended = bool(blocks.counts[-1] == 0)
        if samples.size:
            self._sink(self.start_index + self.count, samples)
            self.count += samples.size

    def _leading(self, blocks: Blocks) -> tuple[int, str | None]:
        """Return how many blocks are in order, and what is wrong with the next one."""
        indices, periods, counts = blocks.indices, blocks.periods_s, blocks.counts
        sent = self.count + np.append(0, np.cumsum(counts)[:-1])
        expected = (self.start_index if self._blocks else indices[0]) + sent
        # An end carries the count of samples sent, which is less where the first index is not 0.
        continues = (indices == expected) | ((counts == 0) & (indices == sent))
        after_end = np.append(self._ended, counts[:-1] == 0)
        valid_index = (indices >= 0) & (indices < MAXIMUM_INDEX) & (indices % 1.0 == 0)
        wrong = (
            ~valid_index | ~continues | after_end
            | ~((periods > 0) & (periods == self.sample_period_s) & np.isfinite(periods)))
        if not wrong.any():
            return indices.size, None
        first = int(np.argmax(wrong))
        index, period, due = indices[first], periods[first], expected[first]
        name = f'stream {self.stream!r}'
        if not valid_index[first]:
            return first, (
                f'{name} has a block with index {index} where {due:.0f} is due, allowed are '
                'integers in 0 … 2**53 - 1')
        if not 0 < period < np.inf:
            return first, (
                f'{name} has the sample period {period} s at index {index:.0f}, it must be '
                'positive and finite')
        if period != self.sample_period_s:
            return first, (
                f'{name} changes its sample period from {self.sample_period_s} s to {period} s at '
                f'index {index:.0f}')
        if after_end[first]:
            return first, f'{name} goes on at index {index:.0f} after its end at {due:.0f}'
        if index > due:
            return first, f'{name} has a gap: index {due:.0f} is due, {index:.0f} comes'
        return first, f'{name} has an overlap: index {due:.0f} is due, {index:.0f} comes again'
