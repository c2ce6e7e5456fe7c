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
samples it has: those that have piled up before a stage that is behind go on as one.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.runtime.streams.endpoints import StreamFault, StreamReader, StreamWriter

__all__ = ['BURST_BLOCKS', 'NAP_S', 'BlockBuffer', 'answer_burst', 'publish_blocks']

NAP_S: Final = 0.0002  # of who has no block: who only yields takes the time of who has one
BURST_BLOCKS: Final = 16  # dealt with at once; meanwhile nobody looks whether the run shall stop
_MOST_JOINED: Final = 7500  # samples: what one datagram can hold

_Samples = NDArray[np.float64]


def answer_burst(
    reader: StreamReader, writer: StreamWriter,
    answer: Callable[[_Samples], Sequence[float] | _Samples],
) -> int:
    """
    Answer the block that `StreamReader.take_one` was not content with, and those behind it.

    Parameters
    ----------
    reader, writer : StreamReader, StreamWriter
        The streams; see `publish_blocks` for the blocks of the answer.
    answer : callable
        Takes the samples of all blocks, shape (N,), and returns as many.

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
    blocks, fault = _take_burst(reader)
    sizes = [block.size for block in blocks]
    if sizes:
        publish_blocks(writer, answer(np.concatenate(blocks)), sizes)
    if fault:
        raise fault
    return max(sizes, default=0)


class BlockBuffer:
    """
    Blocks of a stream that wait for those of another one.

    Parameters
    ----------
    reader : StreamReader
        The stream.

    Attributes
    ----------
    size : int
        Number of samples that wait.

    """

    def __init__(self, reader: StreamReader) -> None:
        self.size = 0
        self._reader = reader
        self._blocks: deque[_Samples] = deque()
        self._fault: StreamFault | None = None

    def fill(self) -> None:
        """
        Take what has come, unless many blocks wait.

        Raises
        ------
        StreamFault
            If samples are missing or the sample period changes; not before all samples that came
            before have been pulled.

        """
        if not self._fault and len(self._blocks) < BURST_BLOCKS and self._reader.take_raw():
            blocks, self._fault = _take_burst(self._reader)
            self._blocks.extend(blocks)
            self.size += sum(block.size for block in blocks)
        if self._fault and not self.size:
            raise self._fault

    def pull(self, count: int) -> list[_Samples]:
        """Return the first samples, at most `size`, block by block."""
        self.size -= count
        blocks = []
        while count:
            block = self._blocks.popleft()
            if block.size > count:
                self._blocks.appendleft(block[count:])
                block = block[:count]
            blocks.append(block)
            count -= block.size
        return blocks

    def pour(self) -> None:
        """
        Move what waits into the queue of the reader, for who looks at single samples.

        Raises
        ------
        StreamFault
            As `fill`; not before the queue is empty.

        """
        for block in self.pull(self.size):
            self._reader.queue.extend(block)
        if self._fault and not self._reader.queue:
            raise self._fault


def publish_blocks(
    writer: StreamWriter, samples: Sequence[float] | _Samples, sizes: Sequence[int],
) -> None:
    """Publish what answers blocks of given sizes, joined as far as they fit into a datagram."""
    first = end = 0
    for size in sizes:
        if end > first and end + size - first > _MOST_JOINED:
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
