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

"""Another table during a run: where it may begin, and what is refused by name."""

import json

import numpy as np
import pytest

from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.tables.motion_table import MotionTable, MotionTableError, write_motion_table
from piezo_ros.control.tables.table_changes import check_successor, nearest_sample
from piezo_ros.control.trajectory_blocks import ChangingTable, trajectory_blocks
from piezo_ros.model import ParameterError

PERIOD_S = 1e-5


def table(scale=1.0, *, start=200, samples=200, period_s=PERIOD_S, command=True, repeat=True):
    turns = np.arange(start + samples) / samples
    reference_um = np.sin(2.0 * np.pi * turns)
    command_um = scale * np.sin(2.0 * np.pi * (turns + 0.01)) if command else None
    return MotionTable(reference_um, command_um, period_s, repeat_from=start if repeat else None)


@pytest.fixture
def written(tmp_path):
    """Return what writes a table and returns its path."""
    def write(name, motion):
        path = tmp_path / f'{name}.npz'
        write_motion_table(path, motion)
        return str(path)

    return write


def trajectory(file, changes=()):
    return TrajectoryParameters(
        waveform='file', file=file, frequency_hz=500.0, periods=10.0, harmonics=0,
        file_changes=json.dumps(
            [{'at_sample': at, 'file': path} for at, path in changes]) if changes else '')


@pytest.mark.parametrize('compiled', [False, True])
def test_each_sample_comes_from_the_table_of_its_time(written, compiled):
    tables = [table(1.0), table(1.02, start=400), table(0.99)]
    paths = [written(str(k), each) for k, each in enumerate(tables)]
    blocks = trajectory_blocks(
        trajectory(paths[0], [(700, paths[1]), (1311, paths[2])]), compiled=compiled)
    expected = [tables[0 if k < 700 else 1 if k < 1311 else 2] for k in range(2000)]
    for block in (7, 500, 2000):
        parts = [blocks(k, min(block, 2000 - k)) for k in range(0, 2000, block)]
        reference_um, command_um = (np.concatenate(each) for each in zip(*parts, strict=True))
        np.testing.assert_array_equal(
            command_um, [each.command_um[each.place(k)] for k, each in enumerate(expected)])
        np.testing.assert_array_equal(
            reference_um, [each.reference_um[each.place(k)] for k, each in enumerate(expected)])


def test_a_change_during_the_run_gives_what_a_listed_one_gives(written):
    first, second = written('first', table()), written('second', table(1.01))
    live = ChangingTable(trajectory(first))
    before = live(0, 900)
    live.add(913, second)
    live.add(913, second)  # asked for twice, as where an answer was lost
    listed = trajectory_blocks(trajectory(first, [(913, second)]))
    assert before == listed(0, 900)
    assert live(900, 1100) == listed(900, 1100)
    assert live.newest == (913, second)
    assert live.has_grown


@pytest.mark.parametrize(('new', 'culprit'), [
    (table(samples=201, start=201), 'it repeats 201 samples, the table in use 200'),
    (table(start=250), 'repeat_from is 250, that of the table in use 200'),
    (table(3.0), 'command_um steps by 0.09'),
    (table(command=False), 'it has no command_um'),
    (table(repeat=False), 'repeat_from is not set: it is played once'),
])
def test_a_table_that_cannot_follow_is_refused_and_the_old_one_stays(written, new, culprit):
    first, bad = written('first', table()), written('bad', new)
    blocks = ChangingTable(trajectory(first))
    with pytest.raises(MotionTableError, match=culprit) as refusal:
        blocks.add(900, bad)
    assert bad in str(refusal.value)
    assert blocks(800, 400) == trajectory_blocks(trajectory(first))(800, 400)
    assert not blocks.has_grown


def test_a_table_of_another_sample_period_or_with_nan_is_refused(written, tmp_path):
    blocks = ChangingTable(trajectory(written('first', table())))
    with pytest.raises(MotionTableError, match='its sample period is 2e-05 s'):
        blocks.add(900, written('slow', table(period_s=2e-5)))
    with pytest.raises(MotionTableError, match='missing.npz: No such file'):
        blocks.add(900, str(tmp_path / 'missing.npz'))
    values = table().reference_um.copy()
    values[17] = np.nan
    np.savez(tmp_path / 'nan.npz', reference_um=values, command_um=values, repeat_from=200)
    with pytest.raises(MotionTableError, match='reference_um is nan at sample 17'):
        blocks.add(900, str(tmp_path / 'nan.npz'))


def test_a_table_that_does_not_close_on_itself_or_jumps_is_refused():
    open_end = table()
    open_end.command_um[-1] += 0.5
    with pytest.raises(MotionTableError, match='command_um steps by'):
        check_successor(table(), open_end, 1000)
    with pytest.raises(MotionTableError, match='command_um jumps by .* at sample 1050'):
        check_successor(table(), table(1.5), 1050)
    check_successor(table(), table(1.5), 1000 - 2)  # where both cross zero


def test_the_nearest_sample_is_where_both_cross():
    at_sample = nearest_sample(table(), table(1.5), 1000)
    assert 1000 <= at_sample < 1200
    assert (at_sample + 2) % 100 == 0


@pytest.mark.parametrize(('text', 'culprit'), [
    ('[{"at_sample": 5}]', 'file_changes: nothing changes at sample 5'),
    ('[{"at_sample": 5, "scheme": "ff"}]', "file_changes has .*'scheme'.* allowed is file"),
    ('[{"at_sample": 5, "file": ""}]', 'allowed is file, a path'),
    ('[{"at_sample": -1, "file": "a.npz"}]', 'file_changes: at_sample is -1'),
    ('[{"at_sample": 5, "file": "a"}, {"at_sample": 5, "file": "b"}]', 'must ascend'),
    ('{', 'file_changes is .* no JSON'),
])
def test_a_list_that_cannot_be_read_is_refused(text, culprit):
    with pytest.raises(ParameterError, match=culprit):
        TrajectoryParameters(waveform='file', file='a.npz', harmonics=0, file_changes=text)


def test_only_the_waveform_file_has_files_that_change():
    with pytest.raises(ParameterError, match="file_changes is given and waveform is 'triangle'"):
        TrajectoryParameters(file_changes='[{"at_sample": 5, "file": "a.npz"}]')


def test_changes_are_within_the_run_and_ascend(written):
    first, second = written('first', table()), written('second', table(1.01))
    blocks = ChangingTable(trajectory(first))
    with pytest.raises(MotionTableError, match='at_sample is 2000, the run has 2000 samples'):
        blocks.add(2000, second)
    blocks.add(900, second)
    with pytest.raises(MotionTableError, match='at_sample is 899, it must be above 900'):
        blocks.add(899, first)
