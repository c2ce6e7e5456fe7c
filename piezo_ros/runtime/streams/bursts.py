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
Blocks that wait are dealt with together, by no more messages than needed.

Where the boundaries of blocks are carries no meaning, and a message costs the same, however many
samples it has: those that have piled up before a node that is behind go on as one. Each message is
sent as soon as it is computed, so that the next node can begin.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter

__all__ = [
    'BURST_BLOCKS',
    'MOST_JOINED',
    'NAP_S',
    'answer_taken',
    'answer_waiting',
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
        The streams. Blocks that wait are joined as far as they fit into a datagram; a longer one
        stays as it is.
    answer : callable
        Takes the index of the first sample and the samples of one message or several, shape (N,),
        and returns as many.

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
    blocks, fault = reader.take_blocks(BURST_BLOCKS)
    sizes = [block.size for block in blocks]
    first = reader.next_index - sum(sizes)  # now, for a run may begin at any index
    for samples in _joined(blocks):
        writer.publish(answer(first, samples))
        first += samples.size
    if fault:
        raise fault
    return max(sizes, default=0)


def _joined(blocks: Sequence[_Samples]) -> Iterator[_Samples]:
    """Join consecutive blocks as far as they fit into a datagram."""
    together: list[_Samples] = []
    count = 0
    for block in blocks:
        if together and count + block.size > MOST_JOINED:
            yield np.concatenate(together)
            together, count = [], 0
        together.append(block)
        count += block.size
    if together:
        # A single one is copied too: for an array that must not be written, as blocks of bytes
        # are, a kernel would be compiled anew.
        yield np.concatenate(together)
