"""
Blocks that wait are dealt with together: one calculation, then message after message.

A message that is sent while its reader still works on the one before wakes nobody; where messages
come one by one, waking their readers costs as much as all the rest.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.nodes.streams import StreamFault, StreamReader, StreamWriter

__all__ = ['BURST_BLOCKS', 'NAP_S', 'BlockBuffer', 'answer_burst', 'publish_blocks']

NAP_S: Final = 0.0002  # of who has no block: who only yields takes the time of who has one
BURST_BLOCKS: Final = 16  # dealt with at once; meanwhile nobody looks whether the run shall stop

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
        The streams; each block is answered by one of the same length.
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
        Take what has come, unless something waits.

        Raises
        ------
        StreamFault
            If samples are missing or the sample period changes; not before all samples that came
            before have been pulled.

        """
        if self.size:
            return
        if self._fault:
            raise self._fault
        if self._reader.take_raw():
            blocks, self._fault = _take_burst(self._reader)
            self._blocks.extend(blocks)
            self.size = sum(block.size for block in blocks)
            if self._fault and not blocks:
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
            self._reader.queue.extend(block.tolist())
        if self._fault and not self._reader.queue:
            raise self._fault


def publish_blocks(
    writer: StreamWriter, samples: Sequence[float] | _Samples, sizes: Sequence[int],
) -> None:
    """Publish samples in blocks of given sizes."""
    first = 0
    for size in sizes:
        if size == 1:
            writer.publish_one(float(samples[first]))
        else:
            writer.publish(samples[first:first + size])
        first += size


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
