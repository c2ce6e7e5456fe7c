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

"""Datagrams that the network loses are sent again: no sample is missing, none is wrong."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.bag import STREAMS, read

SOURCE = Path(__file__).with_name('lossy_network.c')
LOSE_ONE_OF = 25


@pytest.fixture
def lost(rig, tmp_path):
    """Let the processes of the rig lose datagrams, those of discovery too; return how many."""
    compiler = shutil.which('cc')
    if compiler is None:
        pytest.skip('no C compiler')
    library, log = tmp_path / 'lossy_network.so', tmp_path / 'lost'
    subprocess.run(
        [compiler, '-shared', '-fPIC', '-O1', '-o', library, SOURCE, '-ldl'], check=True)
    rig.environment.update(
        LD_PRELOAD=str(library), LOSE_ONE_OF=str(LOSE_ONE_OF), LOST_DATAGRAMS=str(log))
    return lambda: log.stat().st_size


@pytest.mark.parametrize(('scheme', 'periods'), [
    pytest.param('ff', 300, marks=pytest.mark.slow), ('fbff', 3)])
def test_a_run_with_lost_datagrams_has_the_bits_of_the_offline_simulation(
        rig, write_plan, lost, scheme, periods):
    plan = write_plan(scheme, periods=periods)
    live = rig.piezo('run', plan, '-o', rig.directory / 'live', '--separate')
    assert live.wait() == 0, live.output
    assert lost() > 10
    offline = rig.piezo('simulate', plan, '-o', rig.directory / 'offline')
    assert offline.wait() == 0, offline.output
    (bag,) = (rig.directory / 'live' / 'bags').iterdir()
    run, expected = read(bag), read(rig.directory / 'offline' / 'bags' / bag.name)
    assert not run.lost
    for stream in STREAMS:
        np.testing.assert_array_equal(
            run.whole(stream)[1].view(np.uint64), expected.whole(stream)[1].view(np.uint64))
