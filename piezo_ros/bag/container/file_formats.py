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

"""What a file is that is no MCAP file, and the tool that turns it into one."""

from typing import Final

__all__ = ['HEAD_LENGTH', 'other_format']

HEAD_LENGTH: Final = 32  # bytes that tell the format

_FORMATS: Final = (
    (b'version https://git-lfs', 'a Git LFS pointer: `git lfs pull` fetches the file itself'),
    (b'#ROSBAG V2.0', (
        'a ROS 1 bag: `rosbags-convert --src FILE --dst DIRECTORY --dst-storage mcap` of the '
        'package rosbags converts it')),
    (b'SQLite format 3\x00', (
        'a sqlite3 file: `ros2 bag convert` turns its bag into one with MCAP storage')),
    (b'\x28\xb5\x2f\xfd', 'a file compressed by zstd: `zstd -d` unpacks it'),
    (b'\x04\x22\x4d\x18', 'a file compressed by lz4: `lz4 -d` unpacks it'),
    (b'\x1f\x8b', 'a file compressed by gzip: `gzip -d` unpacks it'),
    (b'PK\x03\x04', 'a zip archive: `unzip` unpacks it'),
)


def other_format(head: bytes) -> str | None:
    """
    Return what a file is by its first bytes, and the tool for it.

    Parameters
    ----------
    head : bytes
        The first `HEAD_LENGTH` bytes.

    Returns
    -------
    str or None
        None where the bytes tell nothing.

    """
    return next((words for magic, words in _FORMATS if head.startswith(magic)), None)
