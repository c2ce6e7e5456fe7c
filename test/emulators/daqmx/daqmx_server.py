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
The virtual card in a process of its own: python -m daqmx.daqmx_server [--port N] [--rig FILE] ...

It prints the address that it listens on. With --trace it writes every voltage of the output when it
ends, with --log at once, as float64, which outlives that it is killed.
"""

import argparse
import signal
import sys
import threading
from pathlib import Path

import numpy as np
from daqmx.daqmx_service import served
from daqmx.virtual_card import RigStage, VirtualCard, WireStage

from piezo_ros.model.rig import RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_file


class OutputLog(list):
    """What the output went to, in memory and in a file."""

    def __init__(self, path, outputs_v):
        super().__init__()
        self._path = path
        for values_v in outputs_v:
            self.append(values_v)

    def append(self, values_v):
        super().append(values_v)
        with self._path.open('ab') as file:
            file.write(values_v.astype(np.float64).tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--port', type=int, default=0)
    parser.add_argument('--rig', type=Path, help='ROS parameter file of the plant')
    parser.add_argument(
        '--wire', action='store_true', help='output wired to input in place of the stage')
    parser.add_argument('--held', type=float, help='volts at the output before the first start')
    parser.add_argument('--sensor-offset', type=float, default=0.0)
    parser.add_argument('--bits', type=int, nargs=2, default=(0, 0), metavar=('DAC', 'ADC'))
    parser.add_argument(
        '--wall-clock', type=float, metavar='FACTOR', help='samples in real time, times this')
    parser.add_argument('--trace', type=Path, help='.npy of the output, written at the end')
    parser.add_argument('--log', type=Path, help='file that every voltage is appended to')
    arguments = parser.parse_args()
    values = (
        read_parameter_file(arguments.rig, ['plant']).get('plant', {}) if arguments.rig else {})
    rig = RigParameters.among(values)
    held_v = rig.operating_point_v if arguments.held is None else arguments.held
    stage = WireStage(held_v) if arguments.wire else RigStage(
        rig, sensor_offset_v=arguments.sensor_offset, compiled=True)
    card = VirtualCard(
        stage, held_v=held_v,
        dac_bits=arguments.bits[0], adc_bits=arguments.bits[1],
        wall_clock_factor=arguments.wall_clock)
    if arguments.log:
        card.outputs_v = OutputLog(arguments.log, card.outputs_v)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with served(card, f'127.0.0.1:{arguments.port}') as (_, address):
        print(address, flush=True)
        ended.wait()
    if arguments.trace:
        np.save(arguments.trace, np.concatenate(card.outputs_v))


if __name__ == '__main__':
    sys.exit(main())
