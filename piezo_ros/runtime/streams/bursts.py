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
Blocks that wait are dealt with together: one calculation, and no more messages than needed.

Where the boundaries of blocks are carries no meaning, and a message costs the same, however many
samples it has: those that have piled up before a node that is behind go on as one.
"""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.reader import StreamReader
from piezo_ros.runtime.streams.writer import StreamWriter

__all__ = [
    'BURST_BLOCKS',
    'MOST_JOINED',
    'NAP_S',
    'answer_taken',
    'answer_waiting',
    'publish_blocks',
]

# How long a node without a block sleeps: yielding alone takes time from the node that has one.
NAP_S: Final = 0.0002
BURST_BLOCKS: Final = 16  # handled at once; meanwhile a request to stop the run waits
MOST_JOINED: Final = 7500  # samples: what fits into one datagram

_Samples = NDArray[np.float64]


def answer_waiting(
    reader: StreamReader, writer: StreamWriter, answer: Callable[[int, _Samples], _Samples],
) -> int:
    """
    Answer the samples of a stream that wait.

    Parameters
    ----------
    reader, writer : StreamReader, StreamWriter
        The streams; see `publish_blocks` for the blocks of the answer.
    answer : callable
        Takes the index of the first sample and the samples of all blocks, shape (N,), and returns
        as many.

    Returns
    -------
    int
        Length of the longest block, 0 where there were no samples. `StreamReader.ended` tells of
        the end of the stream.

    Raises
    ------
    StreamFault
        If samples are missing or the sample period changes; what came before is answered.

    """
    sample = reader.take_one()
    if sample is not None:
        writer.publish_one(float(answer(reader.next_index - 1, np.array([sample]))[0]))
        return 1
    return answer_taken(reader, writer, answer)


def answer_taken(
    reader: StreamReader, writer: StreamWriter, answer: Callable[[int, _Samples], _Samples],
) -> int:
    """Do as `answer_waiting`, beginning with a message that was taken and not looked at."""
    if not reader.raw:
        return 0
    blocks, fault = _take_burst(reader)
    sizes = [block.size for block in blocks]
    if sizes:
        samples = np.concatenate(blocks)
        publish_blocks(writer, answer(reader.next_index - samples.size, samples), sizes)
    if fault:
        raise fault
    return max(sizes, default=0)


def publish_blocks(
    writer: StreamWriter, samples: Sequence[float] | _Samples, sizes: Sequence[int],
) -> None:
    """Publish what answers blocks of given sizes, joined as far as they fit into a datagram."""
    first = end = 0
    for size in sizes:
        if end > first and end + size - first > MOST_JOINED:
            writer.publish(samples[first:end])
            first = end
        end += size
    writer.publish(samples[first:end])


def _take_burst(reader: StreamReader) -> tuple[list[_Samples], StreamFault | None]:
    """Return the samples of the block at hand and of those that wait, and what ended them."""
    blocks: list[_Samples] = []
    try:
        for taken in range(1, BURST_BLOCKS + 1):
            samples = reader.take_rest()
            if samples is not None and samples.size:
                blocks.append(samples)
            if taken == BURST_BLOCKS or reader.ended or not reader.take_raw():
                break
    except StreamFault as fault:
        return blocks, fault
    return blocks, None
