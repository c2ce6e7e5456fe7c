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
"""A write that fails (A7): its message names the file, the cause, and what of it is whole."""

import errno
import os
import shutil

import pytest

from piezo_ros.bag import BagWriteError, BagWriter, read, salvage
from piezo_ros.bag.container.rosbag2_writer import Rosbag2Writer
from piezo_ros.live.rescue import rescue

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _fail(*_):
    raise FULL


@pytest.fixture
def cut_bag(tmp_path, monkeypatch):
    """Return a bag with three whole chunks, its disk full, and the error of its writer."""
    writer = BagWriter(tmp_path / 'bag')
    for index in range(0, 400, 100):
        writer.write_block('voltage', index, 1e-5, [float(index)] * 100)
        if index < 300:
            writer.flush()
    with monkeypatch.context() as patch:
        patch.setattr(writer._bag._writer, 'flush', _fail)
        with pytest.raises(BagWriteError) as caught:
            writer.flush()
    assert writer._bag.closed
    return tmp_path / 'bag', str(caught.value)


def test_a7_a_full_disk_is_told_with_the_whole_chunks_of_the_bag(cut_bag):
    path, message = cut_bag
    assert message == (
        f'cannot write {path}/bag_0.mcap: No space left on device; its first 3 chunks are whole, '
        f'`piezo bag salvage {path} -o DIR` saves them where there is room')
    assert read(path, allow_loss=True).samples == 300


def test_a7_no_salvage_is_advised_of_a_bag_without_a_whole_chunk(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    writer._bag._writer.flush = _fail
    with pytest.raises(BagWriteError, match='it holds no whole chunk of messages') as caught:
        writer.flush()
    assert 'piezo bag salvage' not in str(caught.value)


@pytest.mark.parametrize('move', [
    lambda path: shutil.rmtree(path), lambda path: path.rename(path.with_name('elsewhere')),
], ids=['deleted', 'moved'])
@pytest.mark.parametrize('call', ['flush', 'close'])
def test_a7_a_directory_that_is_gone_is_noticed_while_the_bag_is_written(tmp_path, move, call):
    writer = BagWriter(tmp_path / 'bag')
    writer.write_block('voltage', 0, 1e-5, [1.0])
    move(tmp_path / 'bag')
    with pytest.raises(BagWriteError, match='was deleted or moved while it was being written'):
        getattr(writer, call)()


def test_a7_a_rescue_without_room_keeps_the_bag_and_counts_what_is_whole(cut_bag, monkeypatch):
    path, _ = cut_bag
    monkeypatch.setattr(Rosbag2Writer, 'add_topic', _fail)
    (note,) = rescue(path)
    assert note == (
        'the bag was not closed; 3 messages of it are whole, but a bag of them cannot be written '
        f'beside it (No space left on device): `piezo bag salvage {path} -o DIR` saves them where '
        'there is room')
    assert [each.name for each in path.parent.iterdir()] == ['bag']
    monkeypatch.undo()
    assert salvage(path, path.with_name('saved')).messages == {'/voltage': 3}


def test_a7_a_rescue_with_room_saves_what_is_whole(cut_bag):
    path, _ = cut_bag
    (note,) = rescue(path)
    assert note.startswith('the bag was not closed; 3 messages of it were saved')
    assert read(path, allow_loss=True).samples == 300
