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

"""Reading, writing and salvage of runs recorded in rosbag2 directories; needs no ROS."""

from piezo_ros.bag.bag_error import BagError, BagExistsError, BagWriteError
from piezo_ros.bag.bag_reader import read
from piezo_ros.bag.bag_writer import BagWriter
from piezo_ros.bag.recorded_run import Run
from piezo_ros.bag.recording import Recording, open_recording
from piezo_ros.bag.salvage import Salvage, salvage
from piezo_ros.streams import STREAMS, Block, BlockCodec, MalformedBlockError

__all__ = [
    'STREAMS',
    'BagError',
    'BagExistsError',
    'BagWriteError',
    'BagWriter',
    'Block',
    'BlockCodec',
    'MalformedBlockError',
    'Recording',
    'Run',
    'Salvage',
    'open_recording',
    'read',
    'salvage',
]
