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
The bare transport: messages round and round over three hops, no mathematics.

What the node graph is measured against in ``piezo bench``: same message, quality of service and way
of waiting, but neither decoded nor checked nor answered. Run as
``python -m piezo_ros.nodes.bare_ring ROUNDS SAMPLES MESSAGES HOPS --ros-args …`` with the samples
in a message, the messages on their way at once and the hops of this process, 012 for all three. The
process with hop 0 prints how many messages a second came round.
"""

import os
import sys
import time

import rclpy
from std_msgs.msg import Float64MultiArray

from piezo_ros.bag import BlockCodec
from piezo_ros.nodes.bursts import NAP_S
from piezo_ros.nodes.leaving import exit_after
from piezo_ros.nodes.middleware import set_middleware_defaults
from piezo_ros.nodes.qos import STREAM

__all__ = ['HOPS', 'main']

HOPS = 3
_PATIENCE_S = 20.0
_LEAVE_S = 2.0


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
    deadline = time.monotonic() + _PATIENCE_S
    while not (
            all(reader.get_publisher_count() == 1 for reader in readers)
            and all(writer.get_subscription_count() == 1 for writer in writers)):
        if time.monotonic() > deadline:
            print('the ring is not closed', file=sys.stderr)
            return 1
        time.sleep(0.005)
    end = BlockCodec('voltage').encode(0, 1e-5, [])
    ends = list(zip(
        [reader.handle.take_message for reader in readers],
        [writer.handle.publish_raw for writer in writers], strict=True))
    leads = hops[0] == 0
    first_take = ends[0][0]
    if leads:
        # The match on the other side may be seen a little later.
        time.sleep(0.2)
        for _ in range(messages):
            ends[0][1](BlockCodec('voltage').encode(0, 1e-5, [0.5] * samples))
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
                writers[-1].wait_for_all_acked(rclpy.duration.Duration(seconds=2.0))
                exit_after(_LEAVE_S, 0)
                rclpy.try_shutdown()
                return 0
        if progress:
            last = time.perf_counter()
        else:
            if samples > 1:
                time.sleep(NAP_S)
            else:
                os.sched_yield()
            if time.perf_counter() - last > _PATIENCE_S:
                print('the ring has stopped', file=sys.stderr)
                return 1


if __name__ == '__main__':
    sys.exit(main())
