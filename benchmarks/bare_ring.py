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
The bare transport over ROS topics: messages pass three hops in a ring, without any mathematics.

The node graph is compared with it: same message, quality of service and way of waiting, but no
message is decoded, checked or answered. Run as
``python -m benchmarks.bare_ring ROUNDS SAMPLES MESSAGES HOPS --ros-args …`` with the samples in a
message, the messages in the ring at the same time and the hops of this process, 012 for all three.
The process with hop 0 prints the messages per second that complete the ring.
"""

import os
import sys
import time
from typing import Any, Final

import rclpy
from std_msgs.msg import Float64MultiArray

from piezo_ros.bag import BlockCodec
from piezo_ros.runtime.process.leaving import exit_after
from piezo_ros.runtime.process.middleware import set_middleware_defaults
from piezo_ros.runtime.streams.bursts import NAP_S
from piezo_ros.runtime.streams.qos import STREAM

__all__ = ['HOPS', 'main']

HOPS: Final = 3
_TIMEOUT_S: Final = 20.0
_LEAVE_S: Final = 2.0
_MATCH_S: Final = 0.2  # within which the other side has seen a match that this side sees

_Hop = tuple[Any, Any]  # take and publish of the handles of rclpy


def main() -> int:
    """Run the hops of this process."""
    rounds, samples, messages = (int(word) for word in sys.argv[1:4])
    hops = [int(hop) for hop in sys.argv[4]]
    set_middleware_defaults()
    rclpy.init()
    node = rclpy.create_node('ring_' + sys.argv[4])
    readers = [
        node.create_subscription(
            Float64MultiArray, f'hop_{hop}', lambda message: None, STREAM) for hop in hops]
    writers = [
        node.create_publisher(Float64MultiArray, f'hop_{(hop + 1) % HOPS}', STREAM)
        for hop in hops]
    if not _closed(readers, writers):
        print('the ring is not closed', file=sys.stderr)
        return 1
    ends = list(zip(
        [reader.handle.take_message for reader in readers],
        [writer.handle.publish_raw for writer in writers], strict=True))
    leads = hops[0] == 0
    if leads:
        time.sleep(_MATCH_S)
        for _ in range(messages):
            ends[0][1](BlockCodec('voltage').encode(0, 1e-5, [0.5] * samples))
    if not _forward(ends, rounds, leads=leads, naps=samples > 1):
        print('the ring has stopped', file=sys.stderr)
        return 1
    writers[-1].wait_for_all_acked(rclpy.duration.Duration(seconds=2.0))
    exit_after(_LEAVE_S, 0)
    rclpy.try_shutdown()
    return 0


def _closed(readers: list[Any], writers: list[Any]) -> bool:
    """Wait until every hop has its neighbours; return whether it has."""
    deadline = time.monotonic() + _TIMEOUT_S
    while not (
            all(reader.get_publisher_count() == 1 for reader in readers)
            and all(writer.get_subscription_count() == 1 for writer in writers)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def _forward(ends: list[_Hop], rounds: int, *, leads: bool, naps: bool) -> bool:
    """Forward messages until the end of the stream; return whether it came in time."""
    end = BlockCodec('voltage').encode(0, 1e-5, [])
    first_take = ends[0][0]
    count = 0
    start = last = time.perf_counter()
    while True:
        progress = False
        for take, publish in ends:
            taken = take(Float64MultiArray, True)
            if taken is None:
                continue
            progress = True
            raw = taken[0]
            if leads and take is first_take:
                count += 1
                if count == rounds:
                    print(rounds / (time.perf_counter() - start), flush=True)
                    raw = end
            publish(raw)
            if raw == end and (not leads or count >= rounds):
                return True
        if progress:
            last = time.perf_counter()
        else:
            if naps:
                time.sleep(NAP_S)
            else:
                os.sched_yield()
            if time.perf_counter() - last > _TIMEOUT_S:
                return False


if __name__ == '__main__':
    sys.exit(main())
