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

"""What is still on its way to a recorder that ends."""

import time
from collections.abc import Callable, Iterator, Mapping

from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = ['AT_ONCE', 'last_blocks']

AT_ONCE = 64  # blocks of one stream before the next one's turn
_SETTLE_S = 0.2  # how long a stopped recorder waits for what is still on its way
_AT_MOST_S = 2.0  # how long it takes what comes


def last_blocks(
    readers: Mapping[str, StreamReader], warn: Callable[[str], object],
) -> Iterator[tuple[str, bytes]]:
    """
    Take the blocks that still come, until no stream has any for a while.

    Parameters
    ----------
    readers : mapping of str to StreamReader
        The reader of each stream.
    warn : callable
        Takes a sentence on a stream that cannot go on.

    Yields
    ------
    stream : str
        The stream.
    raw : bytes
        The block, serialized.

    """
    open_readers = [reader for reader in readers.values() if not reader.ended]
    taken, quiet = RunningTime(), RunningTime()
    while open_readers and quiet.elapsed_s() < _SETTLE_S and taken.elapsed_s() < _AT_MOST_S:
        for reader in list(open_readers):
            try:
                for _ in range(AT_ONCE):
                    if reader.take_array() is None:
                        break
                    yield reader.stream, reader.raw
                    quiet.restart()
            except StreamFault as fault:
                warn(str(fault))
                open_readers.remove(reader)
            else:
                if reader.ended:
                    open_readers.remove(reader)
        time.sleep(0.001)
