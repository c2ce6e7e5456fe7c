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

import csv
import dataclasses
import os

import pytest

from piezo_ros.report.comparison import agreement, cases, series_label
from piezo_ros.report.tables import text_table, write_csv


def test_text_columns_line_up(scored_runs):
    head, units, rule, *rows = text_table(scored_runs).splitlines()
    assert len(rows) == len(scored_runs)
    ends = [i for i, letter in enumerate(rule + ' ') if letter == ' ' and rule[i - 1] == '-']
    for row in (head, units, *rows):
        assert all(row[end:end + 2].strip() == '' for end in ends)
    assert rows[1].split()[:8] == [
        'FF', 'triangle', '2', '300', '9', f'{scored_runs[1].nrmse_percent:.2f}', '2.10',
        f'{scored_runs[1].deviation_percent:+.1f}']


def test_what_is_unknown_is_a_dash_in_text(scored_runs):
    sine = text_table(scored_runs).splitlines()[-1].split()
    assert sine[6:8] == ['–', '–']
    assert sine[-1] == '–'


def test_csv_gives_back_every_number_exactly(tmp_path, scored_runs):
    write_csv(tmp_path / 'new' / 'runs.csv', scored_runs)
    with (tmp_path / 'new' / 'runs.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(scored_runs)
    for row, run in zip(rows, scored_runs, strict=True):
        assert float(row['nrmse_percent']) == run.nrmse_percent
        assert float(row['max_error_um']) == run.max_error_um
        assert int(row['samples']) == run.samples
        assert row['paper_nrmse_percent'] == (
            '' if run.paper_nrmse_percent is None else str(run.paper_nrmse_percent))


def test_csv_quotes_what_would_break_a_row(tmp_path, scored_runs):
    odd = dataclasses.replace(scored_runs[0], bag='bags/a,"b"\nµ')
    write_csv(tmp_path / 'runs.csv', [odd])
    with (tmp_path / 'runs.csv').open(newline='', encoding='utf-8') as file:
        assert [row['bag'] for row in csv.DictReader(file)] == [odd.bag]


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, scored_runs, monkeypatch):
    path = tmp_path / 'runs.csv'
    path.write_text('old', encoding='utf-8')

    def refuse(*_):
        raise OSError('disk full')

    monkeypatch.setattr(os, 'replace', refuse)
    monkeypatch.setattr(type(path), 'replace', refuse)
    with pytest.raises(OSError, match='disk full'):
        write_csv(path, scored_runs)
    assert path.read_text(encoding='utf-8') == 'old'
    assert os.listdir(tmp_path) == ['runs.csv']


def test_runs_of_the_same_reference_are_one_case(scored_runs):
    groups = cases([scored_runs[3], *scored_runs[:3]])
    assert [case.title for case in groups] == ['Sine, 0.5 µm, 450 Hz', 'Triangle, 2 µm, 300 Hz']
    assert [len(case.runs) for case in groups] == [1, 3]


def test_series_are_named_by_what_tells_them_apart(scored_runs):
    ff = scored_runs[1]
    more = dataclasses.replace(ff, harmonics=15)
    again = dataclasses.replace(ff, bag='bags/again')
    assert series_label(ff, scored_runs[:3]) == 'FF'
    assert series_label(more, [ff, more]) == 'FF, m = 15'
    assert series_label(again, [ff, again]) == 'FF, m = 9, bags/again'


@pytest.mark.parametrize(
    ('ff_percent', 'fbff_percent', 'same_winner'), [(2.31, 1.22, 1), (2.31, 2.44, 0)])
def test_agreement_counts_published_numbers_and_winners(
        scored_runs, ff_percent, fbff_percent, same_winner):
    fb, ff, fbff, sine = scored_runs
    result = agreement([
        fb, dataclasses.replace(ff, nrmse_percent=ff_percent),
        dataclasses.replace(fbff, nrmse_percent=fbff_percent), sine])
    assert result.numbers == 2
    assert result.pairs == 1
    assert result.same_winner == same_winner
    assert result.median_deviation_percent == pytest.approx(
        (10 + 100 * (fbff_percent / 1.22 - 1)) / 2)


def test_agreement_without_published_numbers_is_empty(scored_runs):
    assert agreement([scored_runs[0]]) == (0, None, 0, 0)
