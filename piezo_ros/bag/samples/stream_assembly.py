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

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES, unaligned
from piezo_ros.bag.container.mcap_file import Piece
from piezo_ros.bag.samples.block_arrays import Blocks, decoded
from piezo_ros.bag.samples.sinks import Sink
from piezo_ros.streams import BlockCodec
from piezo_ros.streams.block import HEADER_NUMBERS, MAXIMUM_INDEX

__all__ = ['StreamAssembler', 'same_period']

# A publisher that computes the sample period anew for each block rounds it differently.
_PERIOD_TOLERANCE: Final = 1e-9
# Samples that are filled in a stream, 80 MB; what asks for more is a wrong index.
_MOST_FILLED: Final = 10_000_000
_BLOCK_NUMBERS_BYTES: Final = 8 * HEADER_NUMBERS


def same_period(own_s: float, periods_s: ArrayLike) -> NDArray[np.bool_]:
    """Return which sample periods, seconds, are a given one, but for rounding."""
    same = np.asarray(np.equal(periods_s, own_s))
    if same.all() or not np.isfinite(own_s):
        return same
    return np.asarray(np.abs(np.subtract(periods_s, own_s)) <= _PERIOD_TOLERANCE * own_s)


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
    sample_period_s : float, optional
        Sample period, seconds; by default that of the first block.
    fill_gaps : bool, optional
        Whether samples that are missing between two blocks are handed on as NaN.
    start_index : int, optional
        Index of the first sample that is due; by default that of the first block.

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
    left_out : int
        How many samples came from there on.

    """

    def __init__(
        self, stream: str, sink: Sink, *, keep_not_finite: bool = False,
        sample_period_s: float = 0.0, fill_gaps: bool = False, start_index: int | None = None,
    ) -> None:
        self.stream = stream
        self._sink = sink
        self._keep_not_finite = keep_not_finite
        self._codec = BlockCodec(stream)
        self._blocks = 0
        self._ended = False
        self._fill_gaps = fill_gaps
        self._given_start = start_index
        self._gaps: list[tuple[int, int]] = []
        self._filled = 0  # samples of these gaps; there may be millions of them
        self.start_index = 0
        self.sample_period_s = sample_period_s
        self.count = 0
        self.problem: str | None = None
        self.left_out = 0

    @property
    def ended(self) -> bool:
        """Whether the stream came to its end, as its last block says."""
        return self._ended and self.problem is None

    @property
    def loss(self) -> str | None:
        """The problem and the gaps, and how many samples they cost; None if there is none."""
        sentences = [self._gap_words()] if self._gaps else []
        if self.problem is not None:
            sentences.append(self._problem_words(self.problem))
        return '; '.join(sentences) or None

    def _gap_words(self) -> str:
        first, stop = self._gaps[0]
        return (
            f'stream {self.stream!r} has {len(self._gaps)} gap{"s" * (len(self._gaps) > 1)} of '
            f'{self._filled} samples, the first from index {first} to {stop - 1}')

    def _problem_words(self, problem: str) -> str:
        if not self.left_out:
            return problem
        return (
            f'{problem}; {self.left_out} of {self.count + self.left_out} samples of this '
            'stream are left out')

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
        if not messages.size:
            return
        before = self.count - self._filled
        if self.problem is None:
            self._take(piece, messages)
        if self.problem is not None:
            taken = self.count - self._filled - before
            self.left_out += self._samples_in(piece, messages) - taken

    def _samples_in(self, piece: Piece, messages: NDArray[np.int64]) -> int:
        """Return how many samples messages have room for, whatever else is wrong with them."""
        lengths = unaligned(piece.data, '<u8')[messages + 1].astype(np.int64) + HEAD_BYTES
        header, _ = self._codec.header(0)
        numbers = lengths - (MESSAGE_HEAD_BYTES + len(header) + _BLOCK_NUMBERS_BYTES)
        return int(np.maximum(numbers // 8, 0).sum())

    def _take(self, piece: Piece, messages: NDArray[np.int64]) -> None:
        """Hand on the samples in a piece, up to the first thing that is wrong."""
        blocks, error = decoded(self._codec, piece.data, messages)
        malformed = None if error is None else (
            f'message {self._blocks + blocks.indices.size} of stream {self.stream!r}: {error}')
        if blocks.indices.size:
            self._hand_on(blocks)
        self.problem = self.problem or malformed

    def _hand_on(self, blocks: Blocks) -> None:
        """Hand on the samples of the blocks that are in order."""
        if not self._blocks:
            first = float(blocks.indices[0])
            self.start_index = int(first) if np.isfinite(first) else 0
            if self._given_start is not None and self._given_start < first:
                self.start_index = self._given_start
            self.sample_period_s = self.sample_period_s or float(blocks.periods_s[0])
        good, self.problem = self._leading(blocks)
        samples = self._without_gaps(blocks, good)
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

    def _without_gaps(self, blocks: Blocks, good: int) -> NDArray[np.float64]:
        """Return the samples of the leading blocks, NaN where some are missing between them."""
        counts = blocks.counts[:good]
        samples = blocks.samples[:int(counts.sum())]
        if not (self._fill_gaps and good):
            return samples
        starts = blocks.indices[:good]
        due = np.append(self.start_index + self.count, (starts + counts)[:-1])
        gaps = np.flatnonzero((starts > due) & (counts > 0))
        if not gaps.size:
            return samples
        self._gaps += [(int(due[i]), int(starts[i])) for i in gaps.tolist()]
        places = np.append(0, np.cumsum(counts)[:-1])[gaps]
        lengths = (starts - due)[gaps].astype(np.int64)
        self._filled += int(lengths.sum())
        return np.insert(samples, np.repeat(places, lengths), np.nan)

    def _in_order(self, blocks: Blocks, expected: NDArray[np.float64]) -> bool:
        """Return whether the blocks have samples, a place and a sample period as they should."""
        indices = blocks.indices
        return bool(
            not self._ended and blocks.counts.all() and (indices == expected).all()
            and 0 <= indices[0] and indices[0] % 1.0 == 0 and indices[-1] < MAXIMUM_INDEX
            and 0 < self.sample_period_s < np.inf
            and same_period(self.sample_period_s, blocks.periods_s).all())

    def _leading(self, blocks: Blocks) -> tuple[int, str | None]:
        """Return how many blocks are in order, and what is wrong with the next one."""
        indices, periods, counts = blocks.indices, blocks.periods_s, blocks.counts
        sent = self.count + (np.cumsum(counts) - counts).astype(np.float64)
        expected = (
            self.start_index if self._blocks or self._given_start is not None else indices[0]
        ) + sent
        if self._in_order(blocks, expected):
            return indices.size, None
        if self._fill_gaps:
            expected[1:] = (indices + counts)[:-1]
            sent = expected - self.start_index
            missing = np.where(counts > 0, np.maximum(indices - expected, 0.0), 0.0)
            fillable = self._filled + np.cumsum(missing) <= _MOST_FILLED
            expected = np.where((missing > 0) & fillable, indices, expected)
        # An end carries the count of samples sent, which is less where the first index is not 0.
        continues = (indices == expected) | ((counts == 0) & (indices == sent))
        after_end = np.append(self._ended, counts[:-1] == 0)
        valid_index = (indices >= 0) & (indices < MAXIMUM_INDEX) & (indices % 1.0 == 0)
        wrong = (
            ~valid_index | ~continues | after_end
            | ~((periods > 0) & same_period(self.sample_period_s, periods) & np.isfinite(periods)))
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
        if not same_period(self.sample_period_s, period):
            return first, (
                f'{name} changes its sample period from {self.sample_period_s} s to {period} s at '
                f'index {index:.0f}')
        if after_end[first]:
            return first, (
                f'{name} goes on at index {index:.0f} after its end at {due:.0f}; where another '
                'run follows, run=2 (--run 2) reads it')
        if index > due:
            return first, f'{name} has a gap: index {due:.0f} is due, {index:.0f} comes' + (
                f', at most {_MOST_FILLED} samples of a stream are filled' * self._fill_gaps)
        return first, f'{name} has an overlap: index {due:.0f} is due, {index:.0f} comes again'
