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

"""A stream of a device: what is written, what is fetched, and when it is better to wait."""

import numpy as np
import pytest

from piezo_ros.hardware.device import Underflow
from piezo_ros.nodes.hardware_parts.device_stream import DeviceStream
from piezo_ros.runtime.streams.sample_queue import SampleQueue


class Clocked:
    """A device of which the test says how many voltages have gone out."""

    def __init__(self):
        self.written, self.gone, self.read_from, self.is_finished = 0, 0, 0, False

    def start(self, voltage_v):
        self.written = len(voltage_v)

    def write(self, voltage_v):
        self.written += len(voltage_v)

    def generated(self):
        return min(self.gone, self.written)

    def read(self, count):
        if self.read_from + count > self.written + 1:
            raise Underflow('ran dry', self.written)
        self.read_from += count
        return np.arange(self.read_from - count, self.read_from, dtype=float)

    def finish(self):
        self.is_finished = True


@pytest.fixture
def device():
    return Clocked()


def waiting(count):
    queue = SampleQueue()
    queue.extend(np.arange(float(count)))
    return queue


def test_it_writes_no_more_than_there_is_room_for(device):
    queue, stream = waiting(250), DeviceStream(device, 100, 10)
    stream.start(queue, 250)
    assert device.written == 100
    assert not stream.write(queue)
    device.gone = 30
    assert stream.write(queue)
    assert device.written == 130
    assert len(queue) == 120


def test_it_waits_with_reading_as_long_as_voltages_are_to_come(device):
    queue, stream = waiting(25), DeviceStream(device, 100, 10)
    stream.start(queue, 25)
    fetched = [stream.fetch() for _ in range(3)]
    assert [None if each is None else each.size for each in fetched] == [10, 10, None]
    stream.finish()
    assert stream.fetch().tolist() == [20.0, 21.0, 22.0, 23.0, 24.0, 25.0]
    assert stream.is_over
    assert stream.held_v == 24.0
    assert device.is_finished


def test_an_output_that_has_run_dry_is_told_with_its_index(device):
    queue, stream = waiting(15), DeviceStream(device, 100, 10)
    stream.start(queue, 15)
    stream.fetch()
    device.gone = 15
    with pytest.raises(Underflow) as error:
        stream.fetch()
    assert error.value.index == 15


def test_readings_that_have_piled_up_are_fetched_at_once(device):
    queue, stream = waiting(1000), DeviceStream(device, 500, 10)
    stream.start(queue, 500)
    device.gone = 300
    stream.write(queue)
    assert stream.fetch().size == 40


def test_progress_is_what_has_gone_out_since_it_was_asked(device):
    queue, stream = waiting(50), DeviceStream(device, 100, 10)
    stream.start(queue, 50)
    device.gone = 1
    assert stream.is_making_progress()
    assert not stream.is_making_progress()
    device.gone = 2
    assert stream.is_making_progress()
