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

"""Motions out of files: what is read, what is refused and how."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.control.tables.motion_table import (
    MotionTable,
    MotionTableError,
    read_motion_table,
    write_motion_table,
)

PERIOD_S = 1e-5


@pytest.fixture
def csv(tmp_path):
    def write(text):
        path = tmp_path / 'motion.csv'
        path.write_text(text)
        return path
    return write


def test_a_csv_file_with_all_columns_and_settings_is_read(csv):
    table = read_motion_table(csv(
        '# made by hand\n# sample_period_s: 1e-5\n# repeat_from: 1\n\n'
        'time_s, command_um, reference_um\n0,0.5,1\n1e-5,0.25,2\n2e-5,0.125,3\n'), PERIOD_S)
    np.testing.assert_array_equal(table.reference_um, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(table.command_um, [0.5, 0.25, 0.125])
    assert table.repeat_from == 1


def test_a_reference_alone_is_enough(csv):
    table = read_motion_table(csv('reference_um\n1\n2\n'), PERIOD_S)
    assert table.command_um is None
    assert table.repeat_from is None
    assert table.sample_period_s == PERIOD_S


@given(
    values=st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=20),
    repeat_from=st.none() | st.integers(0, 1), has_command=st.booleans())
def test_an_npz_file_keeps_all_bits(tmp_path_factory, values, repeat_from, has_command):
    path = tmp_path_factory.mktemp('npz') / 'motion.npz'
    reference_um = np.array(values)
    table = MotionTable(
        reference_um, 0.3 * reference_um if has_command else None, PERIOD_S, repeat_from)
    write_motion_table(path, table)
    again = read_motion_table(path, PERIOD_S)
    np.testing.assert_array_equal(again.reference_um, table.reference_um)
    assert (again.command_um is None) == (table.command_um is None)
    if has_command:
        np.testing.assert_array_equal(again.command_um, table.command_um)
    assert again.repeat_from == table.repeat_from


@given(
    samples=st.integers(2, 30), repeat_from=st.none() | st.integers(0, 28),
    index=st.integers(0, 10**6))
def test_the_place_of_a_sample_depends_on_its_index_alone(samples, repeat_from, index):
    if repeat_from is not None and repeat_from > samples - 2:
        return
    table = MotionTable(np.arange(float(samples)), None, PERIOD_S, repeat_from)
    walked = 0
    for _ in range(min(index, 200)):
        walked += 1
        if walked == samples:
            walked = samples - 1 if repeat_from is None else repeat_from
    if index <= 200:
        assert table.place(index) == walked
    assert 0 <= table.place(index) < samples


@pytest.mark.parametrize(('text', 'problem'), [
    ('reference_um\n1\nnan\n', 'reference_um is nan at sample 1'),
    ('reference_um,command_um\n1,2\n2,inf\n', 'command_um is inf at sample 1'),
    ('reference_um\n1\n', 'it has 1 samples, allowed is 2'),
    ('', 'it has no header'),
    ('x\n1\n2\n', "line 1: column 'x', allowed are reference_um, command_um, time_s"),
    ('reference_um,reference_um\n1,1\n', 'line 1: a column is there twice'),
    ('command_um\n1\n2\n', 'it has no reference_um'),
    ('reference_um\n1\ntwo\n', "line 3: 'two' is no list of numbers"),
    ('reference_um,command_um\n1,2\n3\n', 'line 3 has 1 values, the header 2'),
    ('# sample_period_s: 2e-5\nreference_um\n1\n2\n',
     'its sample period is 2e-05 s, that of the run 1e-05 s'),
    ('# sample_period_s: soon\nreference_um\n1\n2\n', "line 1: sample_period_s is 'soon'"),
    ('# repeat_from: 0.5\nreference_um\n1\n2\n', 'repeat_from is 0.5, it must be an integer'),
    ('# repeat_from: 1\nreference_um\n1\n2\n', 'repeat_from is 1, allowed is 0 … 0'),
    ('# repeat_from: -1\nreference_um\n1\n2\n', 'repeat_from is -1'),
    ('time_s,reference_um\n0,1\n1e-5,1\n3e-5,1\n', 'time_s steps by 1e-05 s at sample 0'),
    ('time_s,reference_um\n0,1\n2e-5,1\n4e-5,1\n', 'its sample period is 2e-05 s'),
    ('time_s,reference_um\n0,1\nnan,1\n', 'time_s is not finite'),
])
def test_what_is_no_motion_is_refused_by_name(csv, text, problem):
    path = csv(text)
    with pytest.raises(MotionTableError) as error:
        read_motion_table(path, PERIOD_S)
    assert str(error.value).startswith(f'{path}: ')
    assert problem in str(error.value)


@pytest.mark.parametrize(('name', 'content', 'problem'), [
    ('motion.npz', b'PK no', 'it is no NPZ file'),
    ('motion.csv', b'\xff\xfe\x00', 'it is no text'),
    ('motion.txt', b'', "its suffix is '.txt', allowed are .csv, .npz"),
])
def test_another_kind_of_file_is_refused(tmp_path, name, content, problem):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MotionTableError, match=problem):
        read_motion_table(path, PERIOD_S)


@pytest.mark.parametrize(('arrays', 'problem'), [
    ({'reference_um': np.zeros((2, 2))}, 'reference_um is of 2 dimensions'),
    ({'reference_um': np.array(['a', 'b'])}, 'reference_um is of 1 dimensions and type <U1'),
    ({'reference_um': np.zeros(3), 'command_um': np.zeros(4)}, r'command_um has the shape \(4,\)'),
    ({'reference_um': np.zeros(3), 'y': np.zeros(3)}, "it has an array 'y'"),
    ({'reference_um': np.zeros(3), 'repeat_from': np.zeros(1)}, 'repeat_from is of 1 dimensions'),
])
def test_an_npz_file_of_other_arrays_is_refused(tmp_path, arrays, problem):
    np.savez(tmp_path / 'motion.npz', **arrays)
    with pytest.raises(MotionTableError, match=problem):
        read_motion_table(tmp_path / 'motion.npz', PERIOD_S)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MotionTableError, match=r'none\.csv: No such file'):
        read_motion_table(tmp_path / 'none.csv', PERIOD_S)


def test_a_motion_that_does_not_close_is_told():
    open_end = MotionTable(np.linspace(0.0, 1.0, 101), None, PERIOD_S, repeat_from=0)
    with pytest.raises(MotionTableError, match='jumps by 1 um from sample 100 to the first'):
        open_end.check_steps(0.02)
    MotionTable(np.linspace(0.0, 1.0, 101), None, PERIOD_S).check_steps(0.02)
    jump = MotionTable(np.array([0.0, 0.0, 0.5, 0.5]), None, PERIOD_S)
    with pytest.raises(MotionTableError, match='jumps by 0.5 um from sample 1 to sample 2'):
        jump.check_steps(0.4)
