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

"""When a bag was recorded."""

from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from piezo_ros.bag.container.rosbag2_files import metadata_entries

__all__ = ['recorded_utc']

_NS_PER_S: Final = 1_000_000_000
# Bags of simulations begin at 0, those of a clock that was not set not much later.
_EARLIEST: Final = datetime(2000, 1, 1, tzinfo=timezone.utc)


def recorded_utc(path: Path) -> str:
    """
    Return day and time of the first message, UTC, as text.

    Parameters
    ----------
    path : Path
        The bag, a directory.

    Returns
    -------
    str
        As ``2026-05-04 13:20:41``; '' where metadata.yaml does not tell, and for a simulation
        without a clock.

    """
    try:
        start_ns = (metadata_entries(path) or {})['starting_time']['nanoseconds_since_epoch']
        start = datetime.fromtimestamp(start_ns // _NS_PER_S, tz=timezone.utc)
    except (OSError, KeyError, TypeError, ValueError, OverflowError):  # of foreign bags
        return ''
    return f'{start:%Y-%m-%d %H:%M:%S}' if start >= _EARLIEST else ''
