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

import os

import pytest

from piezo_ros.report.files import write_atomically


def test_a_file_and_its_directory_are_made(tmp_path):
    write_atomically(tmp_path / 'new' / 'a.txt', 'µm\n')
    assert (tmp_path / 'new' / 'a.txt').read_bytes() == 'µm\n'.encode()


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / 'runs.csv'
    path.write_text('old', encoding='utf-8')

    def refuse(*_):
        raise OSError('disk full')

    monkeypatch.setattr(os, 'replace', refuse)
    monkeypatch.setattr(type(path), 'replace', refuse)
    with pytest.raises(OSError, match='disk full'):
        write_atomically(path, 'new')
    assert path.read_text(encoding='utf-8') == 'old'
    assert os.listdir(tmp_path) == ['runs.csv']
