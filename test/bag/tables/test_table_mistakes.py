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

"""Slips in a table that is imported: each is refused by its line, none is another number."""

import re

import pytest

from piezo_ros.bag import BagError, read
from piezo_ros.bag.tables.import_table import ImportChoice, import_table
from piezo_ros.bag.tables.text_table import read_text_table

COLUMNS = {'time': 't:s', 'voltage': 'U:V'}

# What the column of times is, what is said of it.
TIMES = {
    'constant': ([5] * 9, 'the time does not rise: it is 5 s in line 2 and 5 s in line 10'),
    'falling': ([*range(9, 0, -1)], 'the time does not rise'),
    'no number': (['nan'] * 9, 'no row has a time that is a number'),
    'empty': ([''] * 9, 'no row has a time that is a number'),
    'infinite': (['inf'] * 9, 'no row has a time that is a number'),
    'no number at first': (['nan', *range(8)], 'the time in line 2 is nan'),
    'no number at last': ([*range(8), 'nan'], 'the time in line 10 is nan'),
    'infinite at last': ([*range(8), 'inf'], 'the time in line 10 is inf'),
    'too short': ([f'{i}e-320' for i in range(9)], 'row to row, allowed is 1e-09 … 1000 s'),
    'too long': ([f'{i}e306' for i in range(9)], 'row to row, allowed is 1e-09 … 1000 s'),
    'one step': ([0, 0, 0, 0, 1, 1, 1, 1, 1], 'line '),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('resample', [False, True])
@pytest.mark.parametrize('kind', TIMES)
def test_times_that_are_none_are_refused(tmp_path, kind, resample):
    times, said = TIMES[kind]
    path = tmp_path / 'a.csv'
    path.write_text('t,U\n' + ''.join(f'{time},{i}\n' for i, time in enumerate(times)))
    with pytest.raises(BagError, match=re.escape(said)):
        import_table(path, tmp_path / 'bag', ImportChoice(COLUMNS, resample=resample))
    assert not (tmp_path / 'bag').exists()


def test_rows_without_a_time_outside_the_part_do_not_matter(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('t,U\nnan,7\n0,1\n1,2\n2,3\nnan,7\n')
    import_table(path, tmp_path / 'bag', ImportChoice(COLUMNS, from_s=0.0, to_s=3.0))
    assert read(tmp_path / 'bag').voltage_v.tolist() == [1.0, 2.0, 3.0]


def test_more_samples_than_rows_can_tell_are_refused(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('t,U\n0,1\n1,2\n2,3\n')
    with pytest.raises(BagError, match='makes 20* samples of 3 rows, allowed are 1000'):
        import_table(path, tmp_path / 'bag', ImportChoice(
            COLUMNS, resample=True, sample_period_s=1e-9))


def test_numbers_that_their_scale_takes_too_far_are_refused(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('t,U\n0,1\n1,1e305\n2,3\n')
    with pytest.raises(BagError, match="line 3 of the column 'U' is 1e[+]305, which is beyond"):
        import_table(path, tmp_path / 'bag', ImportChoice(COLUMNS, scales={'voltage': 1e9}))


@pytest.mark.parametrize('text', [
    't,U\n0,5,1,25\n0,6,1,26\n',
    't,U\n0,1,25\n1,1,26\n',
    '# t,U\n0,5e-3,1,25\n0,6e-3,1,26\n',
    'U\n0,5\n0,6\n',
    '0,00,1,25\n0,05,1,26\n',
])
def test_decimal_commas_between_commas_are_refused(tmp_path, text):
    path = tmp_path / 'a.csv'
    path.write_text(text)
    with pytest.raises(BagError, match='whole numbers, or fewer with decimal commas'):
        read_text_table(path)


def test_commas_and_points_are_not_both_decimal(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('t;U\n0,5;1.234\n0,6;1.235\n')
    with pytest.raises(BagError, match=r"a comma, '0,5', and with a point, '1\.234'"):
        read_text_table(path)


@pytest.mark.parametrize('text', [
    't,U\n0.5,1.25\n0.6,1.26\n',
    '"t","U"\n"0,5","1,25"\n"0,6","1,26"\n',
    't U\n0,5 1,25\n0,6 1,26\n',
    't\tU\n0,5\t1,25\n0,6\t1,26\n',
    't;U\n0,5;1,25\n0,6;1,26\n',
    'Oscilloscope 7\nt,U\n0.5,1.25\n0.6,1.26\n',
])
def test_decimals_that_can_be_told_apart_are_read(tmp_path, text):
    path = tmp_path / 'a.csv'
    path.write_text(text)
    table = read_text_table(path)
    assert table.column('1').read().tolist() == [0.5, 0.6]
    assert table.column('2').read().tolist() == [1.25, 1.26]


def test_whole_numbers_between_commas_are_read(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('count,code\n1,05\n2,06\n')
    assert read_text_table(path).column('code').read().tolist() == [5.0, 6.0]
