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

"""Quality of service of the project's topics."""

import copy
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = [
    'CLOCK',
    'DIAGNOSTICS',
    'EVERY_STATUS',
    'LATCHED',
    'NEWEST',
    'OVERRIDES',
    'STREAM',
    'overridable',
]

# A reader that does not take blocks the writer; nothing is ever dropped.
STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE)

# The newest value, also for a late reader.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL)

# For a supervisor: the last status of every node, not only the newest of all.
EVERY_STATUS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL)

# For onlookers: a late or slow one misses something, and no writer waits for it.
NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE)

# What the aggregators of diagnostics ask for.
DIAGNOSTICS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE)

# The newest time; readers with best effort, as clients of a clock are, get it too.
CLOCK = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE)


# What the parameters qos_overrides.… take.
OVERRIDES = (
    'allowed are history keep_last or keep_all, depth from 1 on, reliability reliable or '
    'best_effort')


def overridable(profile: QoSProfile) -> dict[str, Any]:
    """
    Return the arguments of an endpoint with a quality of service that users may override.

    History, depth and reliability are the parameters ``qos_overrides.<topic>.publisher.history``
    and so on, read when the endpoint is created.
    """
    return {
        # What is overridden is written into the profile.
        'qos_profile': copy.copy(profile),
        'qos_overriding_options': QoSOverridingOptions.with_default_policies()}
