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

"""Names of the streams, the units of their samples, and the labels of their blocks."""

from typing import Final

__all__ = ['STREAMS', 'label_of', 'stream_with_label']

# Stream (topic) name -> unit of its samples.
STREAMS: Final = {
    'reference': 'um',
    'feedforward': 'um',
    'command': 'um',
    'voltage': 'v',
    'displacement': 'um',
}


def label_of(stream: str) -> str:
    """
    Return the label that every block of a stream carries, ``<stream>_<unit>``.

    Parameters
    ----------
    stream : str
        One of `STREAMS`.

    Raises
    ------
    ValueError
        If the stream is not one of `STREAMS`.

    """
    if stream not in STREAMS:
        raise ValueError(f'stream {stream!r} is none of {", ".join(STREAMS)}')
    return f'{stream}_{STREAMS[stream]}'


def stream_with_label(label: str) -> str | None:
    """Return the stream with this label, None if there is none."""
    return next((stream for stream in STREAMS if label_of(stream) == label), None)
