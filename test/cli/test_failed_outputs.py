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
"""Commands that cannot write (A7): one line with the file, the cause and what is left; exit 1."""

import os
import resource
import subprocess
import sys

import pytest

from piezo_ros.bag import BagWriter
from piezo_ros.cli.main import main


def piezo(*arguments, file_bytes=resource.RLIM_INFINITY, **options):
    """Run a command with a limit on the size of the files that it writes."""
    return subprocess.run(
        [sys.executable, '-m', 'piezo_ros.cli.main', *map(str, arguments)], text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes)),
        **{'capture_output': True, **options})


def test_a7_a_bag_that_cannot_be_written_ends_the_plan_in_one_line(tmp_path, plan):
    done = piezo('simulate', plan, '-o', tmp_path / 'out', file_bytes=20_000)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert 'Traceback' not in done.stderr
    assert f'piezo: cannot write {tmp_path}/out/bags/000_' in last
    assert 'File too large' in last
    assert 'it holds no whole chunk of messages' in last
    assert 'a file may have at most 20000 bytes' in last


def test_a7_a_report_that_cannot_be_written_leaves_the_bags_and_says_so(
        tmp_path, plan, monkeypatch, capsys):
    def fail(path, content):
        raise OSError(28, os.strerror(28), str(path))

    monkeypatch.setattr('piezo_ros.report.page.page_writer.write_atomically', fail)
    assert main(['simulate', str(plan), '-o', str(tmp_path / 'out')]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == (
        f'piezo: the report cannot be written: {tmp_path}/out/report.json: No space left on '
        f'device; the bags of the runs before are whole, `piezo report {tmp_path}/out -o DIR` '
        'reports them where there is room')
    monkeypatch.undo()
    assert main(['report', str(tmp_path / 'out'), '-o', str(tmp_path / 'again')]) == 0


@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='no /dev/full')
def test_a7_an_output_that_is_full_is_named(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
    with open('/dev/full', 'w') as full:
        done = piezo(
            'bag', 'info', tmp_path / 'bag', stdout=full, stderr=subprocess.PIPE,
            capture_output=False)
    assert done.returncode == 1
    assert done.stderr == 'piezo: standard output: No space left on device\n'
