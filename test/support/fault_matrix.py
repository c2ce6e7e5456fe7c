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

"""The failure matrix as data: fault × node or stream × mode × moment of a live run."""

import signal
from itertools import product
from typing import NamedTuple

from piezo_ros.bag import STREAMS

__all__ = ['CELLS', 'Cell']

MODES = ('composed', 'separate')
MOMENTS = ('start', 'run', 'end')
SUPERVISOR = 'supervisor'
PROCESSES = {
    'composed': ('loop', 'recorder', SUPERVISOR),
    'separate': ('plant', 'compensator', 'controller', 'trajectory', 'recorder', SUPERVISOR)}
# Fault -> signal; after SIGSTOP comes SIGCONT.
SIGNALS = {
    'SIGKILL': signal.SIGKILL, 'SIGTERM': signal.SIGTERM, 'SIGINT': signal.SIGINT,
    'SIGHUP': signal.SIGHUP, 'SIGSTOP for 3 s': signal.SIGSTOP}
FILE_SIZE = 'file-size limit'
TOPICS = (*STREAMS, 'demand')
FOREIGN = ('second writer', 'not finite', 'malformed bytes')
FOREIGN_STATUS = 'foreign text'


class Cell(NamedTuple):
    """One cell of the matrix; ``place`` is a process or a topic."""

    fault: str
    place: str
    mode: str
    moment: str

    @property
    def title(self):
        return f'{self.fault}, {self.place}, {self.mode}, {self.moment}'


def _places(mode):
    yield from product(SIGNALS, PROCESSES[mode])
    yield FILE_SIZE, 'recorder'
    yield from product(FOREIGN, TOPICS)
    yield FOREIGN_STATUS, 'status'


CELLS = tuple(
    Cell(fault, place, mode, moment)
    for mode in MODES for fault, place in _places(mode) for moment in MOMENTS)
