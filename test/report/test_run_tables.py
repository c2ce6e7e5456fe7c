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
import io

from piezo_ros.report.run_tables import csv_table, text_table


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


def test_csv_gives_back_every_number_exactly(scored_runs):
    rows = list(csv.DictReader(io.StringIO(csv_table(scored_runs), newline='')))
    assert len(rows) == len(scored_runs)
    for row, run in zip(rows, scored_runs, strict=True):
        assert float(row['nrmse_percent']) == run.nrmse_percent
        assert float(row['max_error_um']) == run.max_error_um
        assert int(row['samples']) == run.samples
        assert row['paper_nrmse_percent'] == (
            '' if run.paper_nrmse_percent is None else str(run.paper_nrmse_percent))


def test_csv_quotes_what_would_break_a_row(scored_runs):
    odd = dataclasses.replace(scored_runs[0], bag='bags/a,"b"\nµ')
    rows = csv.DictReader(io.StringIO(csv_table([odd]), newline=''))
    assert [row['bag'] for row in rows] == [odd.bag]
