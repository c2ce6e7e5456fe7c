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

"""A bag with several runs, one after the other: each of them can be read."""

import numpy as np
import pytest

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read
from piezo_ros.cli.main import main

PERIOD_S = 1e-5
LENGTHS = (500, 40, 300)


def values(stream, run, samples):
    return np.arange(samples) + 1000.0 * run + 0.01 * list(STREAMS).index(stream)


def write_runs(path, *, left_out=(), last_ends=True, flush_every=37):
    """Write runs of some lengths in blocks of seven samples, the streams in turns."""
    with BagWriter(path) as writer:
        written = 0
        for run, samples in enumerate(LENGTHS, 1):
            starts = [*range(0, samples, 7)]
            for start in [*starts, samples]:
                for stream in STREAMS:
                    block = values(stream, run, samples)[start:start + 7]
                    ends = start == samples
                    if ends and ((stream, run) in left_out or (
                            run == len(LENGTHS) and not last_ends)):
                        continue
                    writer.write(stream, BlockCodec(stream).encode(start, PERIOD_S, block))
                    written += 1
                    if written % flush_every == 0:
                        writer.flush()
    return path


@pytest.fixture
def bag(tmp_path):
    return write_runs(tmp_path / 'bag')


@pytest.mark.parametrize('number', [1, 2, 3])
@pytest.mark.parametrize('last_ends', [True, False])
def test_b6_each_run_is_read(tmp_path, number, last_ends):
    bag = write_runs(tmp_path / 'bag', last_ends=last_ends)
    run = read(bag, run=number)
    recording = open_recording(bag, run=number)
    samples = LENGTHS[number - 1]
    assert run.samples == recording.samples == samples
    assert (run.start_index, run.lost) == (0, ())
    for stream in STREAMS:
        np.testing.assert_array_equal(run.whole(stream)[1], values(stream, number, samples))
    for start, stop in ((0, samples), (5, 6), (samples - 9, samples)):
        np.testing.assert_array_equal(
            recording.part(start, stop).voltage_v,
            values('voltage', number, samples)[start:stop])


def test_b6_without_a_choice_the_bag_is_refused_and_the_message_says_how_to_choose(bag, capsys):
    with pytest.raises(BagError, match=r'goes on at index 0 after its end at 500; .*run=2'):
        read(bag)
    assert main(['bag', 'info', str(bag)]) == 3
    assert '--run 2' in capsys.readouterr().err
    assert main(['bag', 'info', str(bag), '--run', '2']) == 0
    assert 'common samples 40 from index 0' in capsys.readouterr().out


@pytest.mark.parametrize(('number', 'reason'), [
    (4, 'has no run 4, its streams have 3'), (0, 'run is 0, runs are counted from 1'),
    (-1, 'run is -1')])
def test_a_run_that_is_not_there_is_refused(bag, number, reason):
    with pytest.raises(BagError, match=reason):
        read(bag, run=number)


def test_where_streams_tell_different_numbers_of_runs_none_is_guessed(tmp_path):
    bag = write_runs(tmp_path / 'bag', left_out={('voltage', 1)})
    with pytest.raises(BagError, match=r'different numbers of runs.*/reference 3.*/voltage 2'):
        read(bag, run=2)
