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

import numpy as np
import pytest

from piezo_ros.bag import read
from piezo_ros.cli.main import main


@pytest.fixture
def command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        try:
            code = main(['bag', *map(str, arguments)])
        except SystemExit as left:
            code = left.code
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'stage.csv'
    rows = [f'{0.5 * k:.1f};{4 + 0.1 * k:.2f};{1000 + 50 * k}' for k in range(30)]
    path.write_text('t [ms];U [V];pos [nm]\n' + '\n'.join(rows) + '\n', encoding='utf-8')
    return path


COLUMNS = ('--columns', 'time=1', 'voltage=2', 'displacement=3')


def test_import_says_what_became_of_the_columns(table, command):
    code, out, err = command(
        'import', table, *COLUMNS, '--scale', 'voltage=15', '--zero', 'voltage=4',
        'displacement=1.0', '-o', 'stage')
    assert (code, err) == (0, '')
    assert '30 samples every 0.0005 s (2000 Hz)' in out
    assert "voltage      0 … 43.5 V, from 'U [V]' in V" in out
    run = read('stage')
    assert run.voltage_v == pytest.approx(1.5 * np.arange(30))
    assert run.displacement_um == pytest.approx(0.05 * np.arange(30))


@pytest.mark.parametrize('suffix', ['.mat', '.npz', '.csv'])
def test_export_goes_by_the_suffix_and_comes_back(table, command, suffix):
    command('import', table, *COLUMNS, '-o', 'stage')
    assert command('export', 'stage', '-o', f'out{suffix}')[0] == 0
    assert command('import', f'out{suffix}', '-o', 'again')[0] == 0
    assert read('again').voltage_v.tobytes() == read('stage').voltage_v.tobytes()


@pytest.mark.parametrize(('arguments', 'code', 'words'), [
    (('--columns', 'voltage', '-o', 'x'), 2, "--columns: 'voltage' is not STREAM=VALUE"),
    (('--columns', 'voltage=1', 'voltage=2', '-o', 'x'), 2, "'voltage' is given twice"),
    ((*COLUMNS, '--scale', 'voltage=0', '-o', 'x'), 2, '--scale: voltage is 0'),
    ((*COLUMNS, '--scale', 'voltage=ten', '-o', 'x'), 2, "voltage is 'ten', allowed is a number"),
    ((*COLUMNS, '--zero', 'voltage=Rest', '-o', 'x'), 2, "1e+12 or 'rest'"),
    ((*COLUMNS, '--sample-rate-hz', '0', '-o', 'x'), 2, '--sample-rate-hz is 0, allowed is'),
    ((*COLUMNS, '--sample-rate-hz', '1000', '-o', 'x'), 1, '--sample-period-s 0.001'),
    (('--columns', 'voltage=pos:V', '-o', 'x'), 2, "did you mean 'pos [nm]'?"),
    (('-o', 'x'), 2, 'has none of the columns time_s, reference_um'),
])
def test_a_wrong_import_names_what_is_allowed(table, command, arguments, code, words):
    found, _, err = command('import', table, *arguments)
    assert words in err
    assert found == code


def test_a_bag_that_is_there_is_not_replaced(table, command):
    command('import', table, *COLUMNS, '-o', 'stage')
    code, _, err = command('import', table, *COLUMNS, '-o', 'stage')
    assert code == 1
    assert 'stage exists' in err


def test_a_file_that_is_not_there_is_named(command):
    code, _, err = command('import', 'no.csv', '-o', 'x')
    assert (code, err) == (1, 'piezo: no.csv: No such file or directory\n')


@pytest.mark.parametrize('name', ['out.xlsx', 'out'])
def test_a_kind_of_file_that_is_not_written_is_refused(table, command, name):
    command('import', table, *COLUMNS, '-o', 'stage')
    code, _, err = command('export', 'stage', '-o', name)
    assert code == 2
    assert 'allowed are .csv, .mat, .h5, .hdf5, .npz, .parquet' in err
