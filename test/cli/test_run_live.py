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

"""``piezo run`` as its user sees it: the demo's numbers, the report, what is never overwritten."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path

from piezo_ros.bag import read

ROOT = Path(__file__).parents[2]
DEMO = ROOT / 'config' / 'experiments' / 'demo.yaml'
PLAN = f"""
format_version: 1
parameter_files: [{ROOT / 'config' / 'rig.yaml'}]
score_periods: 1
runs: [{{scheme: ff, periods: 2}}]
"""


def _piezo(*arguments, timeout=200):
    """Run the command to its end; nodes that it leaves end with it."""
    return subprocess.run(
        [sys.executable, '-m', 'piezo_ros.cli.main', *(str(word) for word in arguments)],
        capture_output=True, text=True, check=False, timeout=timeout,
        env={**os.environ, 'PYTHONPATH': python_path(ROOT)})


@pytest.fixture(scope='module')
def demo(tmp_path_factory):
    directory = tmp_path_factory.mktemp('demo') / 'out'
    result = _piezo('run', DEMO, '-o', directory, '--keep')
    assert result.returncode == 0, result.stderr
    return directory, result


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(PLAN)
    return path


def test_the_demo_meets_the_published_errors(demo):
    directory, _ = demo
    runs = {
        run['scheme']: run for run in json.loads((directory / 'report.json').read_text())['runs']}
    assert runs.keys() == {'fb', 'ff', 'fbff'}
    published = {
        'ff': 1.99,
        'fbff': 1.23,
    }
    for scheme, percent in published.items():
        assert runs[scheme]['paper_nrmse_percent'] == percent
        assert 0.5 * percent <= runs[scheme]['nrmse_percent'] <= 1.5 * percent
    assert runs['fbff']['nrmse_percent'] < runs['ff']['nrmse_percent']
    assert runs['fb']['nrmse_percent'] > 5.0 * runs['ff']['nrmse_percent']


def test_the_report_of_the_demo_holds_what_others_read(demo):
    directory, _ = demo
    report = json.loads((directory / 'report.json').read_text())
    for run in report['runs']:
        assert {
            'scheme': str, 'waveform': str, 'amplitude_um': float, 'frequency_hz': float,
            'harmonics': int, 'nrmse_percent': float, 'max_error_um': float, 'bag': str,
            'samples': int, 'wall_seconds': float,
        }.items() <= {key: type(value) for key, value in run.items()}.items()
        assert (run['waveform'], run['amplitude_um'], run['frequency_hz'], run['harmonics']) == (
            'triangle', 1.0, 300.0, 9)
        assert run['samples'] == 5000
        assert run['wall_seconds'] > 0.0
        assert read(directory / run['bag']).samples == 5000
    assert report['software'].keys() >= {'piezo_ros', 'numpy', 'rclpy', 'mcap'}
    assert (directory / 'report.html').stat().st_size > 10_000
    assert list((directory / 'figures').glob('*.svg'))
    assert (directory / 'runs.csv').is_file()


def test_the_table_of_the_demo_shows_both_numbers(demo):
    _, result = demo
    (line,) = [line for line in result.stdout.splitlines() if line.startswith('FBFF ')]
    assert '1.23' in line
    assert 'report.html' in result.stdout
    assert 'Traceback' not in result.stderr


def test_what_is_no_earlier_output_is_never_replaced(tmp_path, plan):
    directory = tmp_path / 'out'
    directory.mkdir()
    (directory / 'thesis.tex').write_text('years of work')
    for options in ([], ['--force']):
        result = _piezo('run', plan, '-o', directory, '--composed', *options)
        assert result.returncode == 2
        assert f'{directory} exists' in result.stderr
        assert [file.name for file in directory.iterdir()] == ['thesis.tex']
    assert (directory / 'thesis.tex').read_text() == 'years of work'


@pytest.mark.slow  # The same of the directory alone: test_output_directory.py.
def test_an_earlier_output_is_replaced_only_when_asked(tmp_path, plan):
    directory = tmp_path / 'out'
    assert _piezo('simulate', plan, '-o', directory).returncode == 0
    before = (directory / 'report.json').stat().st_mtime_ns
    (directory / 'note.txt').touch()
    result = _piezo('run', plan, '-o', directory, '--composed')
    assert result.returncode == 2
    assert '--force replaces it' in result.stderr
    assert (directory / 'report.json').stat().st_mtime_ns == before
    assert (directory / 'note.txt').exists()
    assert _piezo('simulate', plan, '-o', directory, '--force').returncode == 0
    assert not (directory / 'note.txt').exists()
    assert (directory / 'report.json').stat().st_mtime_ns > before
