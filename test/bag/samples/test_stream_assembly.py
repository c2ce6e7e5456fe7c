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

import struct
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.bag import BlockCodec
from piezo_ros.bag.container.chunk_scan import scan
from piezo_ros.bag.container.mcap_file import Piece
from piezo_ros.bag.samples.sinks import Collected
from piezo_ros.bag.samples.stream_assembly import StreamAssembler

PERIOD_S = 1e-5


class Assembled(NamedTuple):
    start_index: int
    sample_period_s: float
    samples: np.ndarray
    problem: str | None


def _piece(raws):
    data = b''.join(
        struct.pack('<BQHIQQ', 5, 22 + len(raw), 1, 0, 0, 0) + raw for raw in raws)
    return Piece(data, scan(data).messages)


def _assembled(pieces, kept=None):
    samples = Collected(kept)
    assembler = StreamAssembler('voltage', samples)
    for piece in pieces:
        assembler.add(piece, piece.messages)
    return Assembled(
        assembler.start_index, assembler.sample_period_s, samples.samples(), assembler.problem)


def _big_endian(index, samples):
    head = struct.pack('>II', 1, 10) + b'voltage_v\0' + bytes(2)
    layout = struct.pack('>4I', samples.size, samples.size, 2, samples.size + 2)
    numbers = np.concatenate(([index, PERIOD_S], samples)).astype('>f8')
    return b'\0\0\0\0' + head + layout + bytes(4) + numbers.tobytes()


def _dirty(raw):
    dirty = bytearray(raw)
    dirty[2:4] = b'\x07\x09'
    dirty[22:24] = b'\xab\xcd'
    dirty[40:44] = b'\xde\xad\xbe\xef'
    return bytes(dirty)


@given(
    st.lists(st.tuples(st.integers(1, 5), st.sampled_from(['plain', 'dirty', 'big'])), min_size=1),
    st.sets(st.integers(0, 100)), st.booleans(), st.integers(0, 2**40))
def test_any_split_of_the_samples_gives_the_same_stream(blocks, cuts, end, start):
    total = sum(size for size, _ in blocks)
    samples = np.random.default_rng(total).normal(size=total)
    raws, position = [], 0
    for size, kind in blocks:
        part = samples[position:position + size]
        raw = BlockCodec('voltage').encode(start + position, PERIOD_S, part)
        raws.append({
            'plain': raw, 'dirty': _dirty(raw), 'big': _big_endian(start + position, part)}[kind])
        position += size
    if end:
        raws.append(BlockCodec('voltage').encode(start + total, PERIOD_S, []))
    edges = sorted({0, len(raws), *(cut for cut in cuts if cut < len(raws))})
    result = _assembled(
        _piece(raws[first:stop]) for first, stop in pairwise(edges))
    assert result.start_index == start
    assert result.sample_period_s == PERIOD_S
    assert result.problem is None
    np.testing.assert_array_equal(result.samples, samples)


@given(st.lists(st.integers(1, 5), min_size=2, max_size=20), st.data())
def test_the_first_gap_ends_the_stream(sizes, data):
    gap = data.draw(st.integers(1, len(sizes) - 1))
    starts = np.cumsum([0, *sizes])
    codec = BlockCodec('voltage')
    raws = [
        codec.encode(int(start) + (number >= gap), PERIOD_S, np.full(size, float(number)))
        for number, (start, size) in enumerate(zip(starts[:-1], sizes, strict=True))
    ]
    result = _assembled([_piece(raws)])
    assert result.samples.size == starts[gap]
    assert result.problem == (
        f"stream 'voltage' has a gap: index {starts[gap]} is due, {starts[gap] + 1} comes")


def test_messages_between_those_of_other_streams_are_found():
    mine, other = BlockCodec('voltage'), BlockCodec('displacement')
    raws = []
    for index in range(50):
        raws.append(mine.encode_one(index, PERIOD_S, float(index)))
        raws += [other.encode_one(index, PERIOD_S, 0.0)] * (index % 3)
    piece = _piece(raws)
    own = np.array([
        place for place, raw in zip(piece.messages, raws, strict=True) if b'voltage' in raw])
    samples = Collected()
    StreamAssembler('voltage', samples).add(piece, own)
    np.testing.assert_array_equal(samples.samples(), np.arange(50.0))


def test_a_stream_without_blocks_or_with_its_end_alone_has_no_samples_and_no_problem():
    for pieces in ([], [_piece([BlockCodec('voltage').encode(0, PERIOD_S, [])])]):
        assert _assembled(pieces).samples.size == 0
        assert _assembled(pieces).problem is None


@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=20), st.integers(0, 30), st.integers(1, 60),
    st.integers(1, 7), st.integers(0, 10))
def test_any_part_of_the_samples_can_be_kept(sizes, start, length, every, first_index):
    starts = first_index + np.cumsum([0, *sizes])
    raws = [
        BlockCodec('voltage').encode(
            int(begin), PERIOD_S, np.arange(begin, begin + size, dtype=float))
        for begin, size in zip(starts[:-1], sizes, strict=True)]
    kept = range(start, start + length, every)
    result = _assembled([_piece([raw]) for raw in raws], kept)
    expected = [index for index in range(first_index, int(starts[-1])) if index in kept]
    np.testing.assert_array_equal(result.samples, expected)


@pytest.mark.parametrize('cut', range(1, 24))
def test_a_cut_message_is_named_by_its_number(cut):
    codec = BlockCodec('voltage')
    raws = [codec.encode_one(index, PERIOD_S, 1.0) for index in range(4)]
    raws[2] = raws[2][:-cut]
    result = _assembled([_piece(raws[:2]), _piece(raws[2:])])
    assert result.samples.size == 2
    assert "message 2 of stream 'voltage'" in result.problem


def test_gaps_are_filled_up_to_a_limit_of_all_of_them():
    gap, blocks = 4_000_000, 5
    raws = [
        BlockCodec('voltage').encode(number * gap, PERIOD_S, np.ones(1))
        for number in range(blocks)]
    for pieces in ([_piece(raws)], [_piece([raw]) for raw in raws]):
        samples = Collected()
        assembler = StreamAssembler('voltage', samples, fill_gaps=True, keep_not_finite=True)
        for piece in pieces:
            assembler.add(piece, piece.messages)
        assert samples.samples().size == assembler.count == 2 * gap + 1
        assert 'has 2 gaps of 7999998 samples' in assembler.loss
        assert (
            'has a gap: index 8000001 is due, 12000000 comes, at most 10000000 samples of a '
            'stream are filled; 2 of 8000003 samples of this stream are left out') in assembler.loss
