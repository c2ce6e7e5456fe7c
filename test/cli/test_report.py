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
import os
import shutil
from pathlib import Path

import pytest

from piezo_ros.bag import BagWriter, read
from piezo_ros.cli.main import main

DESCRIPTION = (
    '--scheme', 'ff', '--waveform', 'triangle', '--amplitude-um', 1, '--frequency-hz', 300,
    '--harmonics', 9)


@pytest.fixture
def report(capsys):
    def run(*arguments):
        code = main(['report', *map(str, arguments)])
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    directory = tmp_path_factory.mktemp('simulated')
    (directory / 'plan.yaml').write_text(
        'format_version: 1\nruns: [{scheme: [ff, fbff], periods: 5}]\n')
    assert main(['simulate', str(directory / 'plan.yaml'), '-o', str(directory / 'out')]) == 0
    return directory / 'out'


@pytest.fixture
def campaign(simulated, tmp_path):
    return Path(shutil.copytree(simulated, tmp_path / 'campaign'))


@pytest.fixture
def foreign(campaign, tmp_path):
    """Record the streams of the first run again, in chunks, without a word about them."""
    run = read(sorted((campaign / 'bags').iterdir())[0])
    with BagWriter(
            tmp_path / 'foreign', topics={name: f'/{name}' for name in run.streams}) as writer:
        for start in range(0, run.samples, 100):
            for stream in run.streams:
                samples = run.whole(stream)[1][start:start + 100]
                writer.write_block(stream, start, run.sample_period_s, samples)
            writer.flush()
    return tmp_path / 'foreign'


def records(directory):
    return json.loads((directory / 'report.json').read_text())['runs']


def test_the_report_of_a_campaign_is_made_again_from_its_bags(campaign, report, tmp_path):
    code, out, _ = report(campaign, '-o', tmp_path / 'again')
    assert code == 0
    assert f'report: {tmp_path / "again" / "report.html"}' in out
    before, after = records(campaign), records(tmp_path / 'again')
    assert [run['scheme'] for run in after] == ['ff', 'fbff']
    for name in ('nrmse_percent', 'max_error_um', 'samples', 'frequency_hz'):
        assert [run[name] for run in after] == [run[name] for run in before]
    for run in after:
        assert (tmp_path / 'again' / run['bag'] / 'metadata.yaml').is_file()


def test_single_bags_are_reported_in_the_given_order(campaign, report, tmp_path):
    first, second = sorted((campaign / 'bags').iterdir())
    assert report(second, first, '-o', tmp_path / 'again')[0] == 0
    assert [run['scheme'] for run in records(tmp_path / 'again')] == ['fbff', 'ff']


def test_of_a_foreign_bag_must_be_told_what_it_holds(foreign, campaign, report, tmp_path):
    code, _, err = report(foreign, '-o', tmp_path / 'told')
    assert code == 1
    assert f"{foreign}: the metadata of the run lacks 'scheme'" in err
    assert not (tmp_path / 'told').exists()
    assert report(foreign, *DESCRIPTION, '-o', tmp_path / 'told')[0] == 0
    assert records(tmp_path / 'told')[0]['nrmse_percent'] == records(campaign)[0]['nrmse_percent']


def test_runs_of_the_bare_actuator_are_left_out_in_words(report, tmp_path, capsys):
    plan = tmp_path / 'plan.yaml'
    plan.write_text(
        'format_version: 1\nscore_periods: 1\nruns:\n  - {scheme: ff, periods: 2}\n'
        '  - {output: voltage, periods: 1, waveform: decreasing_triangle, harmonics: 0}\n')
    assert main(['simulate', str(plan), '-o', str(tmp_path / 'out')]) == 0
    capsys.readouterr()
    code, out, _ = report(tmp_path / 'out', '-o', tmp_path / 'again', '--periods', 1)
    assert code == 0
    assert '001_bare_decreasing_triangle_3v_300hz: the bare actuator follows no reference' in out
    assert len(records(tmp_path / 'again')) == 1
    (bare,) = (tmp_path / 'out' / 'bags').glob('001_*')
    code, _, err = report(bare, '-o', tmp_path / 'nothing')
    assert code == 1
    assert 'there is no run that follows a reference' in err
    assert not (tmp_path / 'nothing').exists()


def test_a_directory_without_bags_is_no_empty_report(report, tmp_path):
    (tmp_path / 'empty' / 'bags').mkdir(parents=True)
    code, _, err = report(tmp_path / 'empty', '-o', tmp_path / 'out')
    assert code == 1
    assert f'{tmp_path / "empty"}: there is no run' in err


def test_of_a_damaged_bag_what_is_whole_is_reported_unless_that_is_refused(
        foreign, report, tmp_path):
    file = foreign / 'foreign_0.mcap'
    os.truncate(file, round(0.9 * file.stat().st_size))
    code, _, err = report(
        foreign, *DESCRIPTION, '-o', tmp_path / 'out', '--periods', 2, '--no-allow-loss')
    assert code == 1
    assert f'{foreign} is damaged' in err
    code, _, err = report(foreign, *DESCRIPTION, '-o', tmp_path / 'out', '--periods', 2)
    assert code == 3
    assert f'piezo: {foreign}: ' in err
    assert file.name in (tmp_path / 'out' / 'report.html').read_text(encoding='utf-8')


def test_an_earlier_report_needs_force_and_nothing_else_is_replaced(campaign, report, tmp_path):
    assert report(campaign, '-o', tmp_path / 'out')[0] == 0
    code, _, err = report(campaign, '-o', tmp_path / 'out')
    assert code == 2
    assert '--force replaces it' in err
    assert report(campaign, '-o', tmp_path / 'out', '--force')[0] == 0
    (tmp_path / 'thesis').mkdir()
    (tmp_path / 'thesis' / 'thesis.tex').write_text('years of work')
    assert report(campaign, '-o', tmp_path / 'thesis', '--force')[0] == 2
    assert (tmp_path / 'thesis' / 'thesis.tex').read_text() == 'years of work'


def test_more_periods_than_were_recorded_are_refused(campaign, report, tmp_path):
    code, _, err = report(campaign, '-o', tmp_path / 'out', '--periods', 50)
    assert code == 1
    assert '000_ff_triangle_1um_300hz: ' in err
    assert not (tmp_path / 'out').exists()


def test_a13_a_scheme_that_is_no_formula_is_reported(foreign, report, tmp_path):
    told = [r'$\frac{$' if word == 'ff' else word for word in DESCRIPTION]
    assert report(foreign, *told, '-o', tmp_path / 'out')[0] == 0
    assert r'$\frac{$' in (tmp_path / 'out' / 'report.html').read_text()
