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
Finding of the MCAP records in a buffer, such as the inside of a chunk.

Each record begins with its opcode (1 byte) and the length of its body (8 bytes), so that records
are found by a walk from one to the next. In Python this takes about half a microsecond for each
record: little for long records, longer than all the rest for short ones. Where records are short,
all places that look like a message are found at once, as arrays. Where one such message ends at the
next, the walk takes the whole run of them in one step; most chunks are a single run. For any bytes
the result is that of a plain walk.
"""

import struct
from typing import Any, Final, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

__all__ = ['HEAD_BYTES', 'MESSAGE_HEAD_BYTES', 'Records', 'read_head', 'scan', 'unaligned']

HEAD_BYTES: Final = 9  # opcode and length of any record
MESSAGE_HEAD_BYTES: Final = 31  # the same, channel, sequence, log time and publish time
_MESSAGE_BODY_BYTES: Final = MESSAGE_HEAD_BYTES - HEAD_BYTES
_MESSAGE: Final = np.uint8(Opcode.MESSAGE)  # bytes compared with an int are widened first
_LONG_BYTES: Final = 4096  # mean length of the records in a buffer from which a walk is quicker
_SLICE_BYTES: Final = 1 << 20  # candidates take many times the bytes in which they are sought
_Offsets = NDArray[np.int64]
read_head = struct.Struct('<BQ').unpack_from  # opcode and length of a record


class Records(NamedTuple):
    """
    The whole records in a buffer.

    Attributes
    ----------
    messages : ndarray of int64
        Offsets of the message records.
    others : list of int
        Offsets of all other records.
    end : int
        Offset behind the last whole record; the rest is cut off or damaged.

    """

    messages: NDArray[np.int64]
    others: list[int]
    end: int


def unaligned(data: bytes, kind: str) -> NDArray[Any]:
    """Return a view of the little-endian numbers of one kind that begin at each byte of data."""
    dtype = np.dtype(kind)
    count = max(len(data) - dtype.itemsize + 1, 0)
    return np.ndarray((count,), dtype, buffer=data, strides=(1,))


def scan(data: bytes) -> Records:
    """Find the records in a buffer, up to the first that is not whole."""
    return _walk(data, len(data) // _LONG_BYTES) or _scan_runs(data)


def _walk(data: bytes, most: int) -> Records | None:
    """Step from record to record; return None if there are more than so many."""
    messages: list[int] = []
    others: list[int] = []
    position = 0
    last = len(data) - HEAD_BYTES
    for _ in range(most + 1):
        if position > last:
            break
        opcode, length = read_head(data, position)
        following = position + HEAD_BYTES + length
        short = opcode == Opcode.MESSAGE and length < _MESSAGE_BODY_BYTES
        if opcode == 0 or short or following > len(data):
            break
        (messages if opcode == Opcode.MESSAGE else others).append(position)
        position = following
    else:
        return None
    return Records(np.array(messages, dtype=np.int64), others, position)


def _scan_runs(data: bytes) -> Records:
    """Step from one run of messages to the next."""
    starts, ends = _possible_messages(data)
    # The last of each run of possible messages that follow one another without a gap.
    last_of_run = np.append(np.flatnonzero(starts[1:] != ends[:-1]), starts.size - 1)
    runs: list[_Offsets] = [np.empty(0, dtype=np.int64)]
    others: list[int] = []
    position = 0
    while len(data) - position >= HEAD_BYTES:
        first = int(starts.searchsorted(position))
        if first < starts.size and starts[first] == position:
            last = int(last_of_run[last_of_run.searchsorted(first)])
            runs.append(starts[first:last + 1])
            position = int(ends[last])
            continue
        opcode, length = read_head(data, position)
        following = position + HEAD_BYTES + length
        if opcode in (0, Opcode.MESSAGE) or following > len(data):
            break
        others.append(position)
        position = following
    return Records(np.concatenate(runs), others, position)


def _possible_messages(data: bytes) -> tuple[_Offsets, _Offsets]:
    """Return where bytes look like a message record that fits in the buffer, and where it ends."""
    opcodes = np.frombuffer(data, np.uint8)[:max(len(data) - MESSAGE_HEAD_BYTES + 1, 0)]
    found = [
        _possible_in(data, np.flatnonzero(opcodes[first:first + _SLICE_BYTES] == _MESSAGE) + first)
        for first in range(0, max(opcodes.size, 1), _SLICE_BYTES)]
    if len(found) == 1:
        return found[0]
    return np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])


def _possible_in(data: bytes, starts: _Offsets) -> tuple[_Offsets, _Offsets]:
    """Return which of these places are possible messages, and where these end."""
    lengths = unaligned(data, '<u8')[starts + 1]
    fits = (lengths >= _MESSAGE_BODY_BYTES) & (lengths <= len(data))
    starts, lengths = starts[fits], lengths[fits]
    ends = starts + HEAD_BYTES + lengths.astype(np.int64)
    return starts[ends <= len(data)], ends[ends <= len(data)]
