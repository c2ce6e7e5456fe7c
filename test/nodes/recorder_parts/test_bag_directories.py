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

"""Where a recorder writes its bags."""

import pytest

from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.recorder_parts.bag_directories import BagDirectories


def test_later_runs_are_numbered_and_a_foreign_directory_is_refused(tmp_path):
    wanted = str(tmp_path / 'bag')
    directories = BagDirectories()
    for name in ('bag', 'bag_2', 'bag_3'):
        directory = directories.next(wanted)
        assert directory == tmp_path / name
        directory.mkdir()
        directories.note_written(directory)
    with pytest.raises(ParameterError, match='bag exists; it is not overwritten'):
        BagDirectories().next(wanted)


def test_a_name_by_the_time_gives_way_to_what_exists(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('time.strftime', lambda form: 'piezo_now')
    (tmp_path / 'piezo_now').mkdir()
    assert BagDirectories().next('') == tmp_path / 'piezo_now_2'
