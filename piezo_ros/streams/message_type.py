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

"""``std_msgs/msg/Float64MultiArray``, the message type of every stream, as bags describe it."""

from typing import Any, Final

__all__ = ['DEFINITION', 'STREAM_QOS', 'TYPE_HASH', 'TYPE_NAME']

TYPE_NAME: Final = 'std_msgs/msg/Float64MultiArray'
TYPE_HASH: Final = 'RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f'

_RULE: Final = '=' * 80
# The type and every type in it, as readers of the schema encoding 'ros2msg' expect them.
DEFINITION: Final = f"""\
std_msgs/MultiArrayLayout layout
float64[] data
{_RULE}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{_RULE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""

_INFINITE: Final = {'sec': 9223372036, 'nsec': 854775807}
# Reliable and KEEP_ALL, as the nodes offer their streams and as a replay must offer them again.
# rosbag2 refuses a profile that lacks any of the nine keys.
STREAM_QOS: Final[list[dict[str, Any]]] = [{
    'history': 'keep_all',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _INFINITE,
    'lifespan': _INFINITE,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _INFINITE,
    'avoid_ros_namespace_conventions': False,
}]
