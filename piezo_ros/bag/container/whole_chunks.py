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

"""Counts the whole chunks of a file that its writer had to give up, without reading them."""

from pathlib import Path

from mcap.opcode import Opcode

from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, read_head

__all__ = ['count_whole_chunks']

_MAGIC_BYTES = 8


def count_whole_chunks(path: Path) -> int | None:
    """Return how many whole chunks an MCAP file has; None if there is no such file."""
    try:
        size = path.stat().st_size
        with path.open('rb') as file:
            position, count = _MAGIC_BYTES, 0
            while position + HEAD_BYTES <= size:
                file.seek(position)
                opcode, length = read_head(file.read(HEAD_BYTES))
                position += HEAD_BYTES + length
                if opcode == 0 or position > size:
                    break
                count += opcode == Opcode.CHUNK
            return count
    except OSError:
        return None
