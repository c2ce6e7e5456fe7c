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

"""Assembly of one stream, a contiguous sequence of samples, from its blocks."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES, unaligned
from piezo_ros.bag.container.mcap_file import Piece
from piezo_ros.streams import BlockCodec, MalformedBlockError

__all__ = ['Collected', 'Extremes', 'Sink', 'Stream', 'StreamAssembler']

_MAXIMUM_INDEX: Final = 2.0**53
_ENCAPSULATION_BYTES: Final = 4
_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]


class Stream(NamedTuple):
    """
    One stream as far as it is whole.

    Attributes
    ----------
    start_index : int
        Index of the first sample.
    sample_period_s : float
        Sample period, seconds.
    samples : ndarray of float64, shape (n,)
        The samples, in the stream's unit.
    problem : str or None
        What is wrong right behind the last of these samples; None if nothing is.

    """

    start_index: int
    sample_period_s: float
    samples: NDArray[np.float64]
    problem: str | None


# Is handed the index of the first and the samples themselves, piece by piece, without a gap.
Sink = Callable[[int, NDArray[np.float64]], None]


class Collected:
    """
    A sink that keeps samples.

    Parameters
    ----------
    kept : range, optional
        Indices of the samples to keep; all by default.
    share : callable, optional
        Says what share of all samples has been handed on with those that come now.

    """

    def __init__(
        self, kept: range | None = None, share: Callable[[], float] = lambda: 1.0,
    ) -> None:
        self._kept = kept
        self._share = share
        self._values: _Floats = np.empty(0)
        self._count = 0

    def __call__(self, index: int, samples: _Floats) -> None:
        """Keep what is wanted of some samples."""
        if self._kept is not None:
            kept = self._kept
            first = max(kept.start, index)
            first += (kept.start - first) % kept.step
            samples = samples[first - index:max(kept.stop - index, 0):kept.step]
        needed = self._count + samples.size
        if needed > self._values.size:
            self._grow(needed)
        self._values[self._count:needed] = samples
        self._count = needed

    def _grow(self, needed: int) -> None:
        # Once for all, as a rule: what is never written takes no memory, and to copy what is there
        # costs as much as reading it.
        wanted = len(self._kept) if self._kept is not None else int(1.05 * needed / self._share())
        grown = np.empty(max(needed, wanted, self._values.size * 3 // 2))
        grown[:self._count] = self._values[:self._count]
        self._values = grown

    def samples(self) -> _Floats:
        """Return what was kept."""
        return self._values[:self._count]


class Extremes:
    """A sink that keeps the smallest and the largest sample."""

    def __init__(self) -> None:
        self.minimum = np.inf
        self.maximum = -np.inf

    def __call__(self, index: int, samples: _Floats) -> None:
        """Look at some samples."""
        self.minimum = min(self.minimum, float(np.fmin.reduce(samples)))
        self.maximum = max(self.maximum, float(np.fmax.reduce(samples)))


class _Blocks(NamedTuple):
    """Consecutive blocks: index, sample period and N of each, and the samples of all."""

    indices: _Floats
    periods_s: _Floats
    counts: _Integers
    samples: _Floats


class StreamAssembler:
    """
    Checks the blocks of one stream in the order of their recording and hands on their samples.

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
        What is wrong right behind the last of them; None if nothing is.

    """

    def __init__(self, stream: str, sink: Sink, *, keep_not_finite: bool = False) -> None:
        self.stream = stream
        self._sink = sink
        self._keep_not_finite = keep_not_finite
        self._codec = BlockCodec(stream)
        self._messages = 0
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
        lengths = unaligned(piece.data, '<u8')[messages + 1].astype(np.int64) + HEAD_BYTES
        # Groups of equal length are decoded at once; where only few differ, as in a foreign
        # recording of ragged blocks, this costs little more than one group.
        groups = [
            self._group(piece.data, messages, lengths, length)
            for length in _distinct(lengths)
        ]
        malformed = None
        if all(group is not None for _, group in groups):
            blocks = _merged(groups, messages.size)
        else:
            blocks, malformed = self._one_by_one(piece.data, messages, lengths)
        self._messages += messages.size
        if blocks.indices.size:
            self._hand_on(blocks)
        self.problem = self.problem or malformed

    def _group(
        self, data: bytes, messages: _Integers, lengths: _Integers, length: int,
    ) -> tuple[_Integers, _Blocks | None]:
        members = np.flatnonzero(lengths == length)
        return members, self._equal_blocks(data, messages[members], length - MESSAGE_HEAD_BYTES)

    def _equal_blocks(self, data: bytes, messages: _Integers, size: int) -> _Blocks | None:
        """Decode blocks of one size, None unless every one has the layout of `BlockCodec`."""
        header, mask = self._codec.header(0)
        count, rest = divmod(size - len(header), 8)
        count -= 2
        if count < 0 or rest:
            return None
        header, mask = self._codec.header(count)
        starts = messages + MESSAGE_HEAD_BYTES
        if (unaligned(data, '<u2')[starts] != int.from_bytes(header[:2], 'little')).any():
            return None
        words = _rows(data, starts + _ENCAPSULATION_BYTES, size - _ENCAPSULATION_BYTES)
        expected = np.frombuffer(header[_ENCAPSULATION_BYTES:], '<u8')
        matters = np.frombuffer(mask[_ENCAPSULATION_BYTES:], '<u8')
        if ((words[:, :expected.size] & matters) != expected).any():
            return None
        numbers = words[:, expected.size:].view('<f8')
        return _Blocks(
            numbers[:, 0].astype(np.float64), numbers[:, 1].astype(np.float64),
            np.full(messages.size, count), numbers[:, 2:].astype(np.float64).ravel())

    def _one_by_one(
        self, data: bytes, messages: _Integers, lengths: _Integers,
    ) -> tuple[_Blocks, str | None]:
        """Decode blocks of any layout, up to the first that is malformed, and say what it is."""
        blocks = []
        malformed = None
        for start, length in zip(messages.tolist(), lengths.tolist(), strict=True):
            try:
                blocks.append(self._codec.decode(data[start + MESSAGE_HEAD_BYTES:start + length]))
            except MalformedBlockError as error:
                malformed = (
                    f'message {self._messages + len(blocks)} of stream {self.stream!r}: {error}')
                break
        samples = [np.asarray(block.samples, dtype=np.float64) for block in blocks]
        return _Blocks(
            np.array([block.index for block in blocks], dtype=np.float64),
            np.array([block.sample_period_s for block in blocks], dtype=np.float64),
            np.array([sample.size for sample in samples], dtype=np.int64),
            np.concatenate([*samples, np.empty(0)])), malformed

    def _hand_on(self, blocks: _Blocks) -> None:
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

    def _leading(self, blocks: _Blocks) -> tuple[int, str | None]:
        """Return how many blocks are in order, and what is wrong with the next one."""
        indices, periods, counts = blocks.indices, blocks.periods_s, blocks.counts
        sent = self.count + np.append(0, np.cumsum(counts)[:-1])
        expected = (self.start_index if self._blocks else indices[0]) + sent
        if (
            not self._ended and counts.all() and (indices == expected).all()
            and 0 <= indices[0] and indices[-1] < _MAXIMUM_INDEX and indices[0] % 1.0 == 0
            and 0 < self.sample_period_s < np.inf and (periods == self.sample_period_s).all()
        ):
            return indices.size, None  # as a rule; what follows finds out what is wrong
        # An end carries the count of samples sent, which is less where the first index is not 0.
        continues = (indices == expected) | ((counts == 0) & (indices == sent))
        after_end = np.append(self._ended, counts[:-1] == 0)
        valid_index = (indices >= 0) & (indices < _MAXIMUM_INDEX) & (indices % 1.0 == 0)
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


def _distinct(values: _Integers) -> list[int]:
    """Return the distinct values; most often there is one, found without sorting."""
    first = int(values[0])
    return [first] if (values == first).all() else [int(value) for value in np.unique(values)]


def _rows(data: bytes, starts: _Integers, size: int) -> NDArray[np.uint64]:
    """Return the bytes from each start on as rows of words, a view where the stride is regular."""
    if starts.size > 1:
        strides = np.diff(starts)
        if (strides == strides[0]).all():
            return np.ndarray(
                (starts.size, size // 8), '<u8', buffer=data, offset=int(starts[0]),
                strides=(int(strides[0]), 8))
    gathered = unaligned(data, f'V{size}')[starts]
    return gathered.view('<u8').reshape(starts.size, size // 8)


def _merged(groups: list[tuple[_Integers, _Blocks | None]], messages: int) -> _Blocks:
    """Put the blocks of all groups back into the order of the messages."""
    if len(groups) == 1:
        (_, only), = groups
        assert only is not None
        return only
    indices, periods = np.empty(messages), np.empty(messages)
    counts = np.empty(messages, dtype=np.int64)
    for members, blocks in groups:
        assert blocks is not None
        indices[members] = blocks.indices
        periods[members] = blocks.periods_s
        counts[members] = blocks.counts
    ends = np.cumsum(counts)
    samples = np.empty(int(ends[-1]))
    for members, blocks in groups:
        assert blocks is not None
        count = int(blocks.counts[0])
        places = (ends[members] - count)[:, np.newaxis] + np.arange(count)
        samples[places.ravel()] = blocks.samples
    return _Blocks(indices, periods, counts, samples)
