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
"""Limits of the system that are too small (A13): one line that names limit, size and need."""

import errno
import os
import resource
import subprocess
import sys

import pytest

from piezo_ros.live.process_group import ProcessGroup
from piezo_ros.parameters.errors import failure_text
from piezo_ros.resource_limits import COMMAND_BYTES, GRAPH_BYTES

KIB = 1024


def limited(*arguments, address_bytes):
    return subprocess.run(
        [sys.executable, '-m', *arguments], text=True, capture_output=True, check=False,
        preexec_fn=lambda: resource.setrlimit(
            resource.RLIMIT_AS, (address_bytes, address_bytes)))


@pytest.mark.parametrize(('arguments', 'needed_bytes'), [
    (('piezo_ros.cli.main', 'simulate', 'plan.yaml', '-o', 'out'), COMMAND_BYTES),
    (('piezo_ros.cli.main', 'run', 'plan.yaml', '-o', 'out'), GRAPH_BYTES),
    (('piezo_ros.nodes.executables', 'plant'), GRAPH_BYTES),
], ids=['simulate', 'run', 'node'])
def test_a13_too_little_memory_is_refused_before_anything_runs(arguments, needed_bytes):
    done = limited(*arguments, address_bytes=400_000 * KIB)
    assert done.returncode == 1
    assert done.stderr.removeprefix('piezo: ') == (
        'a process has an address space of at most 391 MiB (ulimit -v), at least '
        f'{needed_bytes >> 20} MiB are needed\n')


def test_a13_a_limit_of_files_and_of_memory_is_named_with_its_size(monkeypatch):
    limits = {resource.RLIMIT_FSIZE: 5000, resource.RLIMIT_AS: 3 << 30}
    monkeypatch.setattr(resource, 'getrlimit', lambda number: (
        limits.get(number, resource.RLIM_INFINITY), resource.RLIM_INFINITY))
    too_large = OSError(errno.EFBIG, os.strerror(errno.EFBIG), 'a.csv')
    assert failure_text(too_large) == (
        'a.csv: File too large; a file may have at most 5000 bytes (ulimit -f)')
    assert failure_text(MemoryError()) == (
        'out of memory; a process has an address space of at most 3072 MiB (ulimit -v)')


def test_a13_a_process_that_dies_of_what_it_is_asked_to_end_by_is_not_blamed(tmp_path, monkeypatch):
    # As an interpreter that has not come to the first line of the node yet.
    popen = subprocess.Popen
    monkeypatch.setattr(
        subprocess, 'Popen', lambda command, **options: popen(['sleep', '60'], **options))
    group = ProcessGroup()
    group.start('plant', [], tmp_path / 'plant.log')
    group.stop()
    assert not group.dead()
    assert not group.blamed
