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
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read
from piezo_ros.bag.container import mcap_file
from piezo_ros.bag.container.rosbag2_writer import plain_yaml

PERIOD_S = 1e-5


@pytest.fixture
def bag(write_run, tmp_path):
    """A run in many small chunks."""
    write_run(tmp_path / 'bag', 1000, flush_every=37)
    return tmp_path / 'bag'


def same_facts(recording, run):
    for name in ('namespace', 'sample_period_s', 'start_index', 'samples', 'parameters', 'metadata',
                 'lost'):
        assert getattr(recording, name) == getattr(run, name), name
    assert tuple(recording.streams) == run.streams


def test_a_recording_says_what_the_run_says_and_holds_no_sample(bag):
    recording, run = open_recording(bag), read(bag)
    same_facts(recording, run)
    for stream, summary in recording.streams.items():
        start, samples = run.whole(stream)
        assert summary == (
            start, samples.size, samples.min(), samples.max(), f'/{stream}')


@pytest.mark.parametrize(('start', 'stop'), [(0, 1000), (0, 1), (999, 1000), (120, 541), (37, 74)])
@pytest.mark.parametrize('every', [1, 7])
def test_any_part_is_that_of_the_run(bag, start, stop, every):
    run = read(bag)
    indices = [k for k in range(start, stop) if k % every == 0]
    if not indices:
        with pytest.raises(ValueError, match=f'has no index that {every} divides'):
            open_recording(bag).part(start, stop, every=every)
        return
    part = open_recording(bag).part(start, stop, every=every)
    assert part.samples == len(indices)
    np.testing.assert_allclose(part.time_s, run.time_s[indices], rtol=1e-15)
    for stream, unit in STREAMS.items():
        name = f'{stream}_{unit}'
        np.testing.assert_array_equal(getattr(part, name), getattr(run, name)[indices])
    if every == 1:
        same = run.part(start, stop)
        assert (same.start_index, same.samples) == (part.start_index, part.samples)
        np.testing.assert_array_equal(same.displacement_um, part.displacement_um)


def test_the_pieces_together_are_the_run(bag):
    run = read(bag)
    pieces = list(open_recording(bag).pieces(256))
    assert [piece.samples for piece in pieces] == [256, 256, 256, 232]
    assert [piece.start_index for piece in pieces] == [0, 256, 512, 768]
    for name in ('time_s', 'reference_um', 'voltage_v', 'displacement_um'):
        np.testing.assert_array_equal(
            np.concatenate([getattr(piece, name) for piece in pieces]), getattr(run, name))


def test_only_the_chunks_that_are_needed_are_decompressed(bag, monkeypatch):
    recording = open_recording(bag)
    opened = []
    decompress = mcap_file.chunk_data

    def watched(chunk):
        opened.append(chunk)
        return decompress(chunk)

    monkeypatch.setattr(mcap_file, 'chunk_data', watched)
    recording.part(0, 1000)
    everything = len(opened)
    opened.clear()
    recording.part(960, 1000)
    assert everything > 20
    assert 1 <= len(opened) <= 4


def test_streams_that_are_not_asked_for_are_not_there(bag):
    part = open_recording(bag).part(10, 20, streams=('voltage', 'displacement'))
    assert part.streams == ('voltage', 'displacement')
    with pytest.raises(BagError, match="'reference'"):
        _ = part.reference_um
    with pytest.raises(BagError, match="no samples of the stream 'speed' in the namespace /;"):
        open_recording(bag).part(10, 20, streams=('speed',))


@pytest.mark.parametrize(('start', 'stop'), [(-1, 5), (5, 5), (6, 5), (0, 1001)])
def test_a_part_outside_of_the_samples_is_refused(bag, start, stop):
    for run in (open_recording(bag), read(bag)):
        with pytest.raises(ValueError, match='is empty or outside'):
            run.part(start, stop)


def test_streams_that_lag_behind_each_other_are_put_together(tmp_path):
    """One stream comes whole before the other, as no lockstep would have it."""
    samples = np.random.default_rng(1).normal(size=1000)
    with BagWriter(tmp_path / 'bag') as writer:
        for stream in STREAMS:
            for start in range(0, 1000, 10):
                writer.write_block(stream, start, PERIOD_S, samples[start:start + 10])
                if start % 100 == 0:
                    writer.flush()
    recording = open_recording(tmp_path / 'bag')
    for start, stop in ((0, 1000), (333, 334), (450, 777)):
        part = recording.part(start, stop)
        for name in ('reference_um', 'voltage_v', 'displacement_um'):
            np.testing.assert_array_equal(getattr(part, name), samples[start:stop])


@pytest.mark.parametrize('chunked', [True, False])
def test_foreign_recordings_of_any_kind(record_foreign, tmp_path, chunked):
    path = tmp_path / 'foreign.mcap'
    samples = np.random.default_rng(2).normal(size=5000)
    codecs = {stream: BlockCodec(stream) for stream in ('voltage', 'displacement')}
    blocks = [
        (f'/rig/{stream}', codec.encode(start, PERIOD_S, samples[start:start + 7]))
        for start in range(20, 5000, 7) for stream, codec in codecs.items()]
    record_foreign(path, blocks, chunked=chunked, chunk_size=3000)
    recording = open_recording(path)
    same_facts(recording, read(path))
    assert recording.start_index == 20
    for start, stop in ((0, 1), (100, 2100), (4979, 4980)):
        np.testing.assert_array_equal(
            recording.part(start, stop).voltage_v, samples[20 + start:20 + stop])


def test_what_is_whole_of_a_cut_bag_can_be_read_in_parts(bag):
    file = bag / 'bag_0.mcap'
    os.truncate(file, round(0.6 * file.stat().st_size))
    with pytest.raises(BagError, match='is damaged'):
        open_recording(bag)
    recording, run = open_recording(bag, allow_loss=True), read(bag, allow_loss=True)
    same_facts(recording, run)
    assert recording.lost
    part = recording.part(recording.samples - 50, recording.samples)
    np.testing.assert_array_equal(part.displacement_um, run.displacement_um[-50:])


def test_a_bag_that_changes_meanwhile_is_noticed(bag, write_run, tmp_path):
    recording = open_recording(bag)
    write_run(tmp_path / 'other' / 'bag', 500, flush_every=37)
    os.replace(tmp_path / 'other' / 'bag' / 'bag_0.mcap', bag / 'bag_0.mcap')
    with pytest.raises(BagError, match='has changed'):
        recording.part(0, 1000)


# Prints the peak memory of a command, MB.
MEASURED = """
    import resource
    import sys
    from piezo_ros.cli.main import main
    code = main(sys.argv[1:])
    print('peak', resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
    sys.exit(code)
"""


def peak_mb(*arguments):
    done = subprocess.run(
        [sys.executable, '-c', textwrap.dedent(MEASURED), *map(str, arguments)], text=True,
        capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return float(done.stdout.rpartition('peak ')[2])


def write_long(path, samples):
    """Write a run of a 300 Hz triangle, five streams of so many samples."""
    period = 1000  # samples, three periods
    phase = np.arange(period + 1) * 300.0 * PERIOD_S
    reference = 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * phase))
    values = {
        'reference': reference, 'feedforward': reference, 'command': reference,
        'voltage': reference / 1.3, 'displacement': 0.98 * np.roll(reference, 3)}
    metadata = {
        'scheme': 'ff', 'waveform': 'triangle', 'amplitude_um': '1.0', 'frequency_hz': '300.0',
        'harmonics': '9'}
    with BagWriter(path, metadata=metadata, compression='lz4') as writer:
        writer.attach_parameters(plain_yaml({'/plant': {'ros__parameters': {'seed': 1}}}))
        for start in range(0, samples, period):
            for stream, array in values.items():
                writer.write_block(stream, start, PERIOD_S, array[:period])
        for stream in values:
            writer.write_block(stream, samples, PERIOD_S, [])


@pytest.mark.slow
def test_a_bag_of_a_hundred_million_samples_needs_no_more_memory_than_a_small_one(tmp_path):
    # 2e7 of each of five streams: 800 MB of numbers.
    peaks = {}
    for name, samples in (('small', 200_000), ('large', 20_000_000)):
        bag = tmp_path / name
        write_long(bag, samples)
        peaks[name] = {
            'info': peak_mb('bag', 'info', bag),
            'report': peak_mb('report', bag, '-o', tmp_path / f'{name}_report'),
            'identify': peak_mb(
                'identify', 'hysteresis', bag, '--every', samples // 20_000 - 1, '--elements', '3',
                '-o', tmp_path / f'{name}.yaml'),
            'window': peak_mb(
                'identify', 'hysteresis', bag, '--from-s', 0.5, '--to-s', 0.6, '--elements', '3',
                '-o', tmp_path / f'{name}_window.yaml'),
        }
    print(peaks)
    for command, peak in peaks['large'].items():
        assert peak < peaks['small'][command] + 100.0, command
