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
A plant with a stage that logs what it is driven with.

Run as a file, with the arguments of the plant; `PIEZO_STAGE_LOG` names the log: little-endian
doubles, the voltage of each sample period, V. NaN stands where the ramp to zero begins.
"""

import math
import os
import struct
import sys

from piezo_ros.model import Rig
from piezo_ros.nodes import executables
from piezo_ros.nodes.plant_parts.kept_rig import KeptRig


def log_the_stage(path):
    """Have every rig of this process log what it is driven with, from the ramp on."""
    log = open(path, 'ab', buffering=0)  # noqa: SIM115  until the process ends
    drive, come_to_rest = Rig.drive, KeptRig.come_to_rest

    def logged_drive(rig, voltage_v):
        for number in range(voltage_v.size):
            drive(rig, voltage_v[number:number + 1])
            log.write(struct.pack('<d', rig.driven_v))

    def logged_come_to_rest(kept, slew_v_per_s):
        held_v = kept.rig.driven_v if kept.rig else 0.0
        log.write(struct.pack('<2d', math.nan, held_v))
        come_to_rest(kept, slew_v_per_s)

    Rig.drive, KeptRig.come_to_rest = logged_drive, logged_come_to_rest


if __name__ == '__main__':
    log_the_stage(os.environ['PIEZO_STAGE_LOG'])
    sys.exit(executables.plant())
