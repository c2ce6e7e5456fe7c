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

"""
Trials of damaged bags: what `piezo bag info`, `read` and `salvage` must do with each of them.

A trial has a number. The number alone gives the bag, its damage and the places of it.
"""

import contextlib
import io
import os
import random
import shutil
import signal
import traceback
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import yaml
from bag_mutations import MUTATIONS, Special
from mcap_mutations import BYTES, without_data_checksum

from piezo_ros.bag import STREAMS, BagError, BagWriter, read, salvage
from piezo_ros.cli.main import main

__all__ = ['BagTrials', 'make_bags']

PERIOD_S = 1e-5
SAMPLES = 30
BLOCKS = {'single': 1, 'blocks': 4}
COMPRESSIONS = ('none', 'lz4', 'zstd')
FILES = 3  # of a split bag
PATIENCE_S = 30.0  # of one trial, on a busy machine
OF_ANOTHER_BAG = 'file of another bag'
PARAMETERS = '/plant:\n  ros__parameters:\n    seed: 7\n'


@dataclass
class Bag:
    """A bag in memory and what is in it: samples by stream, and those of the bag beside it."""

    name: str
    files: dict
    samples: dict
    other: 'Bag' = field(default=None, repr=False)


class HangError(BaseException):
    """A trial that takes too long; no handler of exceptions takes it for its own."""


def _samples(seed):
    return {
        stream: np.random.default_rng([seed, number]).normal(
            size=SAMPLES + (stream == 'displacement'))
        for number, stream in enumerate(STREAMS)}


def _write(directory, samples, size, span, compression):
    """Write the samples of a range of indices, with a chunk for each third of them."""
    with BagWriter(directory, compression=compression, metadata={'scheme': 'fb'}) as writer:
        writer.attach_parameters(PARAMETERS)
        for first in range(span.start, span.stop, size):
            for stream, values in samples.items():
                part = values[first:min(first + size, span.stop)]
                if part.size:
                    writer.write_block(stream, first, PERIOD_S, part)
            if (first - span.start) % (len(span) // 3) < size:
                writer.flush()
        for stream, values in samples.items():
            if span.stop > values.size or stream == 'displacement':
                if span.stop >= values.size:
                    writer.write_block(stream, values.size, PERIOD_S, [])


def _files_of(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def _split(directory, samples, size, compression):
    """Return the files of a bag of several files, as a recorder makes them that splits."""
    files, information = {}, None
    length = SAMPLES // FILES
    for number in range(FILES):
        stop = SAMPLES + 1 if number == FILES - 1 else (number + 1) * length
        part = directory / f'part_{number}'
        _write(part, samples, size, range(number * length, stop), compression)
        files[f'bag_{number}.mcap'] = (part / f'part_{number}_0.mcap').read_bytes()
        new = yaml.safe_load((part / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
        if information is None:
            information = new
            continue
        for entry, other in zip(
                information['topics_with_message_count'], new['topics_with_message_count'],
                strict=True):
            entry['message_count'] += other['message_count']
    information['relative_file_paths'] = sorted(files)
    information.pop('files', None)
    files['metadata.yaml'] = yaml.safe_dump({'rosbag2_bagfile_information': information}).encode()
    return files


def make_bags(directory):
    """Return bags of each compression: single samples, blocks, and several files."""
    bags = []
    for compression in COMPRESSIONS:
        for kind in (*BLOCKS, 'split'):
            pair = []
            for seed in range(2):
                samples, place = _samples(seed), directory / f'{compression}_{kind}_{seed}'
                if kind == 'split':
                    files = _split(place, samples, BLOCKS['blocks'], compression)
                else:
                    _write(place / 'bag', samples, BLOCKS[kind], range(SAMPLES + 1), compression)
                    files = _files_of(place / 'bag')
                pair.append(Bag(f'{compression} {kind}', files, samples))
            pair[0].other = pair[1]
            bags.append(pair[0])
    return bags


def _of_another_bag(bag, generator, files):
    name = generator.choice(sorted(files))
    files[name] = bag.other.files[name]


def _put(directory, files):
    """Write a bag in memory to the disk."""
    directory.mkdir(parents=True)
    for name, content in files.items():
        path = directory / name
        if content is Special.PIPE:
            os.mkfifo(path)
        elif content is Special.DIRECTORY:
            path.mkdir()
        elif content is Special.LOOP:
            path.symlink_to(name)
        else:
            path.write_bytes(content)


class BagTrials:
    """
    Trials by number, and what came out of them.

    Parameters
    ----------
    directory : Path
        A directory for the bags of each trial in turn.
    bags : list of Bag
        The bags that are damaged.

    Attributes
    ----------
    counts : Counter
        How often each kind of damage had each outcome: 'whole', 'loss told' or 'refused'.
    failures : list of str
        What did not hold, by trial.

    """

    names = (*MUTATIONS, OF_ANOTHER_BAG)

    def __init__(self, directory, bags):
        self._directory = directory
        self._bags = bags
        self.counts = Counter()
        self.failures = []

    def run(self, number):
        """Make one trial."""
        bag, name, files = self.damaged(number)
        place = self._directory / 'trial'
        shutil.rmtree(place, ignore_errors=True)
        _put(place / 'bag', files)
        path = place / 'bag'
        # A file alone, as a recorder that was killed leaves it; of a split bag it is a whole bag.
        if number % 5 == 4 and not bag.name.endswith('split'):
            path = next(iter(sorted((place / 'bag').glob('*.mcap'))), path)
        with self._named(f'trial {number}, {bag.name}, {name}'):
            outcome = _Trial(
                path, place, bag, name, has_checksum=self._has_checksum(number)).outcome()
            self.counts[name.partition(' + ')[0], outcome] += 1

    def damaged(self, number):
        """Return bag, name of the damage and damaged files of a trial."""
        generator = random.Random(number)
        bag = self._bags[number % len(self._bags)]
        name = self.names[number // len(self._bags) % len(self.names)]
        files = self.files_before(number)
        # Nothing of the kind is in this bag.
        with contextlib.suppress(IndexError, ValueError):
            if name == OF_ANOTHER_BAG:
                _of_another_bag(bag, generator, files)
            else:
                MUTATIONS[name](generator, files)
        if number % 4 == 3:
            second = generator.choice([*BYTES])
            with contextlib.suppress(IndexError, ValueError, TypeError):
                MUTATIONS[second](generator, files)
                name = f'{name} + {second}'
        return bag, name, files

    def files_before(self, number):
        """Return the files of the bag of a trial, before the damage."""
        files = dict(self._bags[number % len(self._bags)].files)
        if not self._has_checksum(number):
            files.update({
                name: without_data_checksum(content) for name, content in files.items()
                if name.endswith('.mcap')})
        return files

    def _has_checksum(self, number):
        """Return whether the bag has a checksum of all data, as ours do and others do not."""
        rounds, place = divmod(number // len(self._bags), len(self.names))
        return (rounds + place) % 2 == 0

    @contextlib.contextmanager
    def _named(self, title):
        """Note whatever goes wrong, and a trial that does not end."""
        def expire(_number, _frame):
            raise HangError

        before = signal.signal(signal.SIGALRM, expire)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
        try:
            yield
        except HangError:
            self.failures.append(f'{title}: does not end')
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            self.failures.append(
                f'{title}: {type(error).__name__}: {error} ({where.name}, line {where.lineno})')
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)


class _Trial:
    """One damaged bag and all that reads it."""

    def __init__(self, path, place, bag, damage, *, has_checksum):
        self._path, self._place, self._bag = path, place, bag
        # A record that is dropped is missed by the summary, unless that is damaged too.
        self._is_twice = ' + ' in damage
        self._has_checksum = has_checksum
        is_mixed = damage.startswith(OF_ANOTHER_BAG)
        self._originals = [bag.samples, *([bag.other.samples] if is_mixed else [])]

    def outcome(self):
        """Return what became of the bag; an AssertionError says what does not hold."""
        code = self._told_by_info()
        strict = self._read(allow_loss=False)
        loose = strict or self._read(allow_loss=True)
        lost = () if loose is None else loose.lost
        if strict is not None:
            assert not lost, f'read() takes a bag that has lost {lost}'
        if code == 0:
            assert strict is not None, '`bag info` exits with 0, read() refuses the bag'
            self._assert_complete(strict)
        elif code == 1:
            assert loose is None, '`bag info` refuses what read() takes'
        self._salvage(loose, is_whole=code == 0)
        return ('whole', 'refused', '', 'loss told')[code]

    def _told_by_info(self):
        said, wrong = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
            code = main(['bag', 'info', str(self._path)])
        assert code in range(4), f'`bag info` exits with {code}'
        told = wrong.getvalue()
        assert bool(told) == bool(code), f'`bag info` exits with {code} and says {told!r}'
        assert all(line.startswith('piezo: ') for line in told.splitlines()[:1]), told
        assert 'Traceback' not in told, told
        # 2 says that there can be no such path.
        return 1 if code == 2 else code

    def _read(self, *, allow_loss):
        """Return the run, None if it is refused."""
        try:
            run = read(self._path, allow_loss=allow_loss)
        except BagError:
            return None
        self._assert_right(run)
        return run

    def _assert_right(self, run):
        """Assert that every sample is what was recorded at its index."""
        for stream in run.streams:
            start, values = run.whole(stream)
            right = np.zeros(values.size, bool)
            for samples in self._originals:
                expected = samples[stream][start:start + values.size]
                assert expected.size == values.size, f'samples beyond the end of {stream}'
                right |= values == expected
            assert right.all(), (
                f'{stream} is wrong from index {start + int(np.argmin(right))} on')

    def _assert_complete(self, run):
        for stream, values in self._bag.samples.items():
            assert stream in run.streams, f'{stream} is missing and nothing is said of it'
            assert run.whole(stream)[1].size == values.size, (
                f'{stream} has {run.whole(stream)[1].size} of {values.size} samples and nothing '
                'is said of it')
        if self._is_twice:
            return
        # Without that checksum a byte that is flipped in a metadata record is just another byte.
        if self._has_checksum:
            assert run.metadata.get('scheme') == 'fb', f'metadata {run.metadata}'
        assert run.parameters == {'/plant': {'seed': 7}}, f'parameters {run.parameters}'

    def _salvage(self, loose, *, is_whole):
        output = self._place / 'whole'
        try:
            result = salvage(self._path, output)
        except BagError:
            assert not output.exists(), 'a salvage that failed leaves a bag'
            assert loose is None, 'salvage refuses what read() takes'
            return
        left = [path.name for path in self._place.iterdir() if path.name.startswith('.')]
        assert not left, f'salvage leaves {left}'
        # A sample that is no number is kept as it is.
        owed = [loss for loss in (loose.lost if loose else ()) if 'it must be finite' not in loss]
        assert result.lost or not owed, f'salvage does not tell what read() tells: {owed}'
        # Such times do not fit into a bag of rosbag2.
        is_mistimed = any('with a log time beyond' in loss for loss in result.lost)
        saved = self._saved(output, result, is_refused=loose is None or is_mistimed)
        if saved is None:
            return
        self._assert_right(saved)
        if loose is not None and not is_mistimed:
            for stream in loose.streams:
                assert stream in saved.streams, f'salvage loses {stream}'
                size, saved_size = loose.whole(stream)[1].size, saved.whole(stream)[1].size
                assert saved_size >= size, (
                    f'salvage keeps {saved_size} of {size} samples of {stream}')
        if is_whole and not is_mistimed:
            assert not result.lost, f'salvage of a whole bag tells {result.lost}'
            self._assert_complete(saved)

    @staticmethod
    def _saved(output, result, *, is_refused):
        """Return the run that was saved, None if there is none in it."""
        try:
            return read(output)
        except BagError as error:
            strict = str(error)
        assert 'is damaged' not in strict, f'salvage writes a damaged bag: {strict}'
        is_told = result.lost or 'it must be finite' in strict
        assert is_told or is_refused, f'salvage tells no loss, its bag is refused: {strict}'
        try:
            return read(output, allow_loss=True)
        except BagError as error:
            loose = str(error)
        assert is_refused, f'what salvage saved is refused: {loose}'
        return None
