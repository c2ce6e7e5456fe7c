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

import re

import numpy as np
import pytest

from piezo_ros.bag import BagError, open_recording, read
from piezo_ros.bag.tables.export_table import EXPORT_SUFFIXES, export_table
from piezo_ros.bag.tables.import_table import ImportChoice, import_table, read_table
from piezo_ros.parameters.errors import PlanError

ROWS = 40
VOLTAGE_V = np.sin(np.arange(ROWS) / 3.0) + 1.5
POSITION_NM = 1e3 * (7.25 + 2.0 * np.cos(np.arange(ROWS) / 3.0))
COLUMNS = {'voltage': 'U:V', 'displacement': 'pos:nm'}


def write_npz(path):
    np.savez(path, U=VOLTAGE_V, pos=POSITION_NM)


def write_mat(path):
    from scipy.io import savemat
    savemat(path, {'rec': {'U': VOLTAGE_V, 'pos': POSITION_NM[:, np.newaxis]}, 'note': 'text'})


def write_hdf5(path):
    h5py = pytest.importorskip('h5py', reason='the extra [data] is not installed')
    with h5py.File(path, 'w') as file:
        file['lab/U'], file['lab/pos'] = VOLTAGE_V, POSITION_NM
        file['lab/comment'] = 'text'


def write_tdms(path):
    nptdms = pytest.importorskip('nptdms', reason='the extra [data] is not installed')
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject(
                'lab', name, values, {'wf_increment': 1e-4, 'unit_string': unit})
            for name, values, unit in (('U', VOLTAGE_V, 'V'), ('pos', POSITION_NM, 'nm'))])


def write_parquet(path):
    pyarrow = pytest.importorskip('pyarrow', reason='the extra [data] is not installed')
    from pyarrow import parquet
    parquet.write_table(pyarrow.table({'U': VOLTAGE_V, 'pos': POSITION_NM}), path)


def write_mat73(path):
    """Write HDF5 behind a user block, as MATLAB does: matrices are turned."""
    h5py = pytest.importorskip('h5py', reason='the extra [data] is not installed')
    with h5py.File(path, 'w', userblock_size=512) as file:
        for name, values in (('U', VOLTAGE_V), ('pos', POSITION_NM)):
            file[name] = values[np.newaxis]
            file[name].attrs['MATLAB_class'] = np.bytes_('double')
    with path.open('r+b') as file:
        file.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM')


WRITERS = {
    'a.npz': write_npz, 'a.mat': write_mat, 'a.h5': write_hdf5, 'a.tdms': write_tdms,
    'a.parquet': write_parquet, 'b.mat': write_mat73}


@pytest.mark.parametrize('name', WRITERS)
def test_arrays_of_any_file_become_the_same_bag(tmp_path, name):
    WRITERS[name](tmp_path / name)
    imported = import_table(tmp_path / name, tmp_path / 'bag', ImportChoice(
        COLUMNS, zeros={'displacement': 7.25}, sample_period_s=1e-4))
    run = read(tmp_path / 'bag')
    assert imported.samples == run.samples == ROWS
    assert run.sample_period_s == 1e-4
    assert np.array_equal(run.voltage_v, VOLTAGE_V)
    assert np.array_equal(run.displacement_um, POSITION_NM * 1e-3 - 7.25)
    assert run.metadata['import.displacement'].endswith('pos in nm, zero 7.25')


def test_a_tdms_file_tells_units_and_sample_period(tmp_path):
    write_tdms(tmp_path / 'a.tdms')
    imported = import_table(tmp_path / 'a.tdms', tmp_path / 'bag', ImportChoice(
        {'voltage': 'lab/U', 'displacement': 'pos'}))
    assert imported.sample_period_s == 1e-4
    assert np.array_equal(read(tmp_path / 'bag').displacement_um, POSITION_NM * 1e-3)


TABLES = {
    'a comma': 'time [ms],U [V],pos [nm]\n0.0,0.5,100\n0.1,0.75,200\n0.2,1.0,250\n',
    'a decimal comma': 'time [ms];U [V];pos [nm]\n0,0;0,5;100\n0,1;0,75;200\n0,2;1,0;250\n',
    'tabs, a preamble and units of their own': (
        'Model\tX200\nRate\t10000\nNote\tloop 3\n\ntime\tU\tpos\n(ms)\t(V)\t(nm)\n\n'
        '0.0\t0.5\t100\n0.1\t0.75\t200\n0.2\t1.0\t250\n'),
    'blanks and a comment': '# time/ms U/V pos/nm\n0.0 0.5 100\n0.1  0.75 200\n0.2 1.0 250\n',
    'a text column and empty lines': (
        'time_ms,mode,U_V,pos_nm\n0.0,up,0.5,100\n\n0.1,up,0.75,200\n0.2,down,1.0,250\n\n'),
    'quotes and a mark of UTF-8': (
        '\ufeff"time (ms)","U (V)","pos (nm)"\n"0.0","0.5","100"\n"0.1","0.75","200"\n'
        '"0.2","1.0","250"\n'),
}


@pytest.mark.parametrize('kind', TABLES)
def test_tables_in_text_are_read_as_they_come(tmp_path, kind):
    path = tmp_path / 'a.csv'
    path.write_text(TABLES[kind], encoding='utf-8')
    numbers = [column.name for column in read_table(path).columns]
    imported = import_table(path, tmp_path / 'bag', ImportChoice(
        dict(zip(('time', 'voltage', 'displacement'), numbers, strict=True))))
    run = read(tmp_path / 'bag')
    assert imported.sample_period_s == pytest.approx(1e-4, rel=1e-12)
    assert run.voltage_v.tolist() == [0.5, 0.75, 1.0]
    assert run.displacement_um == pytest.approx([0.1, 0.2, 0.25])


def test_columns_without_a_header_have_numbers_and_a_sensor_a_scale(tmp_path):
    path = tmp_path / 'a.txt'
    path.write_text('0.0 0.1\n5.0 0.2\n10.0 0.3\n', encoding='latin-1')
    import_table(path, tmp_path / 'bag', ImportChoice(
        {'voltage': '1:mV', 'displacement': '2:V'}, {'voltage': 15.0, 'displacement': 20.0},
        {'displacement': 0.1}, sample_period_s=0.01))
    run = read(tmp_path / 'bag')
    assert run.voltage_v == pytest.approx([0.0, 0.075, 0.15])
    assert run.displacement_um == pytest.approx([0.0, 2.0, 4.0])


def test_the_zero_at_rest_is_the_mean_before_the_voltage_moves(tmp_path):
    path = tmp_path / 'a.csv'
    rows = [(0.0, 5.0 + 0.01 * (-1)**k) for k in range(20)] + [(0.1 * k, 6.0) for k in range(1, 9)]
    path.write_text('U_V,pos_um\n' + ''.join(f'{u},{y}\n' for u, y in rows), encoding='utf-8')
    choice = {'voltage': 'U_V', 'displacement': 'pos_um'}
    imported = import_table(path, tmp_path / 'bag', ImportChoice(
        choice, zeros={'displacement': 'rest'}, sample_period_s=0.1))
    assert read(tmp_path / 'bag').displacement_um[-1] == pytest.approx(1.0)
    assert 'the mean of 20 rows' in imported.notes[0]
    with pytest.raises(BagError, match='moves? after 2 rows'):
        import_table(path, tmp_path / 'other', ImportChoice(
            choice, zeros={'displacement': 'rest'}, sample_period_s=0.1, from_s=1.8))


@pytest.mark.parametrize('suffix', EXPORT_SUFFIXES)
def test_what_is_exported_comes_back_with_the_same_bits(tmp_path, suffix):
    if suffix in ('.h5', '.hdf5'):
        pytest.importorskip('h5py', reason='the extra [data] is not installed')
    write_npz(tmp_path / 'a.npz')
    import_table(tmp_path / 'a.npz', tmp_path / 'bag', ImportChoice(COLUMNS, sample_period_s=0.2))
    table = tmp_path / f'out{suffix}'
    export_table(open_recording(tmp_path / 'bag'), table, suffix)
    import_table(table, tmp_path / 'again', ImportChoice())
    first, again = read(tmp_path / 'bag'), read(tmp_path / 'again')
    assert again.sample_period_s == first.sample_period_s
    assert again.voltage_v.tobytes() == first.voltage_v.tobytes()
    assert again.displacement_um.tobytes() == first.displacement_um.tobytes()


TEXT = 'U [V],pos [nm],x\n0,1,1\n1,2,2\n2,3,3\n'
REFUSALS = [
    ({'voltage': 'V_in:V'}, {}, PlanError, "no column 'V_in'"),
    ({'voltage': 'pos [mm]:V'}, {}, PlanError, "did you mean 'pos [nm]'?"),
    ({'voltage': 'x'}, {}, PlanError, "unit of the column 'x'; say voltage=x:UNIT, allowed are V"),
    ({'voltage': 'U [V]', 'displacement': 'U [V]'}, {}, PlanError, '--scale displacement=FACTOR'),
    ({'voltage': 'pos [nm]'}, {}, PlanError, "is 'nm', allowed are V, mV, uV, kV"),
    ({'volts': 'U [V]'}, {}, PlanError, "'volts' is no stream, allowed are time, reference"),
    ({'time': 'x:s'}, {}, PlanError, 'names no stream beside the time'),
    ({'voltage': 'U [V]'}, {'scales': {'command': 2.0}}, PlanError, "--scale: 'command' is no"),
    ({'voltage': 'U [V]'}, {'sample_period_s': None}, PlanError, 'tells no sample period'),
    ({'voltage': 'U [V]'}, {'resample': True}, PlanError, '--resample needs a column of times'),
    ({'voltage': 'U [V]'}, {'from_s': 9.0}, PlanError, 'it lasts from 0 s to 0.2 s'),
]


@pytest.mark.parametrize(('columns', 'further', 'error', 'words'), REFUSALS)
def test_what_is_asked_wrongly_is_refused_with_what_is_allowed(
        tmp_path, columns, further, error, words):
    (tmp_path / 'a.csv').write_text(TEXT, encoding='utf-8')
    with pytest.raises(error, match=re.escape(words)):
        import_table(tmp_path / 'a.csv', tmp_path / 'bag', ImportChoice(
            columns, **{'sample_period_s': 0.1, **further}))
    assert not (tmp_path / 'bag').exists()


FAULTS = {
    'U_V,pos_nm\n1,2\n1,abc\n2,3\n': "line 3, column 2 is 'abc'",
    'U_V,pos_nm\n1,2\n,5\n2,3\n': "line 3 of the column 'U_V' is nan, 1 of 3 rows",
    'U_V,pos_nm\n1,2\n1,\n2,3\n': 'line 3 of the column .pos_nm. is nan.*--allow-loss',
    'nothing here\n': 'has no table',
    'U_V,pos_nm\n1,2\n2,3\nU_V,pos_nm\n1,2\n': 'line 2 is a row of the table as well',
    'U_V,pos_nm\n1,2\n2\n1,2\n': 'line 2 is a row of the table as well',
}


@pytest.mark.parametrize('text', FAULTS)
def test_what_is_wrong_in_a_file_is_told_with_its_line(tmp_path, text):
    (tmp_path / 'a.csv').write_text(text, encoding='utf-8')
    with pytest.raises(BagError, match=FAULTS[text]):
        import_table(tmp_path / 'a.csv', tmp_path / 'bag', ImportChoice(
            {'voltage': 'U_V', 'displacement': 'pos_nm'}, sample_period_s=0.1))


def test_a_missing_displacement_may_be_allowed(tmp_path):
    (tmp_path / 'a.csv').write_text('U_V,pos_nm\n1,2\n1,\n2,3\n', encoding='utf-8')
    imported = import_table(tmp_path / 'a.csv', tmp_path / 'bag', ImportChoice(
        {'voltage': 'U_V', 'displacement': 'pos_nm'}, sample_period_s=0.1, allow_loss=True))
    assert len(imported.lost) == 1
    assert np.isnan(read(tmp_path / 'bag', keep_not_finite=True).displacement_um[1])


@pytest.mark.parametrize('name', ['a.xlsx', 'a'])
def test_another_kind_of_file_is_refused_with_those_that_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(b'1,2\n')
    with pytest.raises(PlanError, match=r'allowed are \.csv, \.tsv'):
        read_table(tmp_path / name)


@pytest.mark.parametrize('name', ['a.mat', 'a.npz', 'a.csv', 'a.h5', 'a.tdms', 'a.parquet'])
def test_a_file_that_is_none_is_named(tmp_path, name):
    for module, suffix in (('h5py', '.h5'), ('nptdms', '.tdms'), ('pyarrow', '.parquet')):
        if name.endswith(suffix):
            pytest.importorskip(module, reason='the extra [data] is not installed')
    (tmp_path / name).write_bytes(b'\0\1\2 no such thing' * 40)
    with pytest.raises(BagError, match=re.escape(name)):
        read_table(tmp_path / name)
