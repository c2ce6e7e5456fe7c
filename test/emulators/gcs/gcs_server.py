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
The virtual controller in a process of its own: python -m gcs.gcs_server [--rig FILE] ...

It prints the address that it listens on.
"""

import argparse
import signal
import sys
import threading
from pathlib import Path

from gcs.virtual_controller import VirtualController, served

from piezo_ros.model.rig import RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_file


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rig', type=Path, help='ROS parameter file of the plant')
    parser.add_argument('--held', type=float, help='target before the first start, um')
    parser.add_argument('--scale', type=float, default=1.2, help='um of target for each volt')
    arguments = parser.parse_args()
    values = (
        read_parameter_file(arguments.rig, ['plant']).get('plant', {}) if arguments.rig else {})
    controller = VirtualController(
        RigParameters.among(values), target_scale_um_per_v=arguments.scale, held_um=arguments.held)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with served(controller) as (_, address):
        print(address, flush=True)
        ended.wait()


if __name__ == '__main__':
    sys.exit(main())
