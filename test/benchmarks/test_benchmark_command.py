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

import json
import re

import pytest

from benchmarks import bags, kernel_speeds, measurement, sweeps
from benchmarks.__main__ import main

SMALL = 20_000


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Shorten the measurements: their values do not matter here."""
    monkeypatch.setattr(kernel_speeds, '_SAMPLES', SMALL)
    monkeypatch.setattr(kernel_speeds, '_PERIODS', 10.0)
    monkeypatch.setattr(measurement, '_CALLS', 1)
    kernel_speeds._voltage_v.cache_clear()
    yield
    kernel_speeds._voltage_v.cache_clear()


def bench(*arguments):
    return main(['--rounds', '2', *arguments])


def test_the_kernels_are_measured_written_and_compared(tmp_path, capsys):
    path = tmp_path / 'bench.json'
    only = ['--only', 'chain,inverse,forward,closed_loop', '--json', str(path)]
    assert bench(*only) == 0
    record = json.loads(path.read_text())
    assert set(record['results']) == {
        'chain', 'chain_rate', 'inverse', 'forward', 'closed_loop', 'closed_loop_rate'}
    assert set(record['ratios']) == {
        'inverse_over_chain', 'forward_over_chain', 'closed_loop_over_chain'}
    for row in record['results'].values():
        assert len(row['values']) == 2
        assert 0 < row['minimum'] <= row['median'] <= row['maximum']
    assert 'ns/sample' in capsys.readouterr().out

    assert bench(*only, '--append') == 0
    record = json.loads(path.read_text())
    assert record['rounds'] == 4
    assert len(record['results']['inverse']['values']) == 4
    capsys.readouterr()
    assert bench('--only', 'chain', '--json', str(path), '--append') == 2
    told = capsys.readouterr()
    assert 'of other measurements' in told.err
    assert 'round 1' not in told.out + told.err

    # So much slower or quicker than an earlier benchmark as no busy machine makes it.
    for factor, code in ((1e-6, 1), (1e6, 0)):
        earlier = json.loads(path.read_text())
        for ratio in earlier['ratios'].values():
            ratio['median'] *= factor
        (tmp_path / 'earlier.json').write_text(json.dumps(earlier))
        assert bench('--only', 'chain,inverse', '--compare', str(tmp_path / 'earlier.json')) == code
        out = capsys.readouterr().out
        assert f'{code} of 1 ratios are worse by more than 15 %' in out
        assert ('WORSE' in out) == bool(code)


def test_the_picture_is_drawn_from_the_file(tmp_path, capsys):
    path, picture = tmp_path / 'bench.json', tmp_path / 'bench.svg'
    assert bench('--only', 'yardsticks,inverse', '--json', str(path)) == 0
    assert main(['--draw', str(path), '-o', str(picture)]) == 0
    text = picture.read_text()
    assert re.search(r'>Kernels, ns/sample<', text)
    assert re.search(r'>inverse<', text)
    assert 'chain' not in text
    assert main(['--draw', str(path), '-o', str(picture.with_suffix('.png'))]) == 0
    assert picture.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--only', 'nothing'], "'nothing' is no measurement and no group"),
    (['--compare', 'none.json'], 'cannot read none.json'),
    (['--draw', 'none.json'], '--draw and -o belong together'),
    (['--draw', 'none.json', '-o', 'a.pdf'], '-o is a.pdf, it must end in .svg or .png'),
    (['--rounds', '0'], '--rounds is 0'),
    (['--append'], '--append needs --json'),
])
def test_what_cannot_be_done_is_refused(arguments, message, capsys):
    assert bench(*arguments) == 2
    assert message in capsys.readouterr().err


def test_the_list_names_every_group(capsys):
    assert bench('--list') == 0
    out = capsys.readouterr().out
    assert {'yardsticks', 'kernels', 'bag', 'fits'} <= set(out.splitlines())


@pytest.mark.slow
def test_bags_and_fits_are_measured(tmp_path):
    path = tmp_path / 'bench.json'
    assert main([
        '--rounds', '1', '--only', 'yardsticks,bag_write_single,fits', '--json',
        str(path)]) == 0
    record = json.loads(path.read_text())
    assert not record['failed']
    assert {'bag_write_single', 'bag_read_single', 'fit_hysteresis', 'fit_dynamics', 'tune_pi'} <= (
        set(record['results']))
    assert 'bag_read_single_over_chain' in record['ratios']
    written, read = bags._write_and_read(20_000, 1000, 5 * 20_000)()
    assert written > 0
    assert read > 0


def test_a_sweep_is_measured(monkeypatch):
    monkeypatch.setattr(sweeps, '_DRAWS', 4)
    (rate,) = sweeps._rate(2)
    assert rate > 0
