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

"""A run of known numbers, written by the writer under test and by a recorder that is not ours."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from piezo_ros.bag import STREAMS, BagWriter, BlockCodec
from piezo_ros.streams.message_type import DEFINITION, TYPE_HASH, TYPE_NAME

SAMPLE_PERIOD_S = 1e-5
STRING_HASH = 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
WALL_CLOCK_NS = 1_700_000_000_000_000_000


def _run_samples(count: int) -> dict[str, np.ndarray]:
    return {
        stream: np.random.default_rng(number).normal(size=count + (stream == 'displacement'))
        for number, stream in enumerate(STREAMS)
    }


@pytest.fixture
def run_samples() -> Callable[[int], dict[str, np.ndarray]]:
    """Samples of each stream; displacement has one more than asked for, as in every run."""
    return _run_samples


@pytest.fixture
def write_run() -> Callable[..., dict[str, np.ndarray]]:
    """Write a whole run of single samples in lockstep order and return its samples."""
    def write(
        directory: Path, count: int = 20, *, flush_every: int = 0, prefix: str = '', **options,
    ) -> dict[str, np.ndarray]:
        samples = _run_samples(count)
        topics = {stream: f'{prefix}/{stream}' for stream in STREAMS}
        with BagWriter(directory, topics=topics, **options) as writer:
            writer.attach_parameters('/plant:\n  ros__parameters:\n    seed: 7\n')
            for index in range(count + 1):
                for stream, values in samples.items():
                    if index < values.size:
                        writer.write_block(stream, index, SAMPLE_PERIOD_S, values[index:index + 1])
                if flush_every and (index + 1) % flush_every == 0:
                    writer.flush()
            for stream, values in samples.items():
                writer.write_block(stream, values.size, SAMPLE_PERIOD_S, [])
        return samples
    return write


@pytest.fixture
def record_foreign() -> Callable[..., None]:
    """Write blocks as `ros2 bag record -s mcap` does: wall-clock times, no record of ours."""
    def record(
        path: Path,
        blocks: list[tuple[str, bytes]],
        *,
        compression: str = 'none',
        chunk_size: int = 786_432,
        chunked: bool = True,
        indexed: bool = True,
        crcs: bool = False,
    ) -> None:
        with path.open('wb') as file:
            writer = Writer(
                file, chunk_size=chunk_size, compression=CompressionType[compression.upper()],
                use_chunking=chunked, enable_crcs=crcs,
                index_types=IndexType.ALL if indexed else IndexType.NONE)
            writer.start('ros2', 'libmcap 1.4.1')
            array = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
            text = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
            channels = {}
            for number, (topic, raw) in enumerate(blocks):
                if topic not in channels:
                    schema, digest = (
                        (text, STRING_HASH) if topic.endswith('status') else (array, TYPE_HASH))
                    channels[topic] = writer.register_channel(
                        topic, 'cdr', schema, {'topic_type_hash': digest})
                writer.add_message(
                    channels[topic], WALL_CLOCK_NS + 1000 * number, raw,
                    WALL_CLOCK_NS + 1000 * number - 300, number)
            writer.finish()
    return record


@pytest.fixture
def blocks_of() -> Callable[..., list[tuple[str, bytes]]]:
    """Serialize samples as (topic, bytes), in blocks of the given sizes, with an end block."""
    def blocks(
        samples: dict[str, np.ndarray], size: int = 1, *, start: int = 0, prefix: str = '',
    ) -> list[tuple[str, bytes]]:
        result = []
        longest = max(values.size for values in samples.values())
        for first in range(0, longest, size):
            for stream, values in samples.items():
                part = values[first:first + size]
                if part.size:
                    raw = BlockCodec(stream).encode(start + first, SAMPLE_PERIOD_S, part)
                    result.append((f'{prefix}/{stream}', raw))
        for stream, values in samples.items():
            raw = BlockCodec(stream).encode(start + values.size, SAMPLE_PERIOD_S, [])
            result.append((f'{prefix}/{stream}', raw))
        return result
    return blocks


@pytest.fixture
def write_split() -> Callable[[Path, int], np.ndarray]:
    """Write a bag of files with ten voltages each, without metadata.yaml; return the voltages."""
    def write(directory: Path, files: int) -> np.ndarray:
        values = np.arange(10.0 * files)
        directory.mkdir()
        part = directory.with_name('part')
        for number in range(files):
            with BagWriter(part, topics={'voltage': '/voltage'}) as writer:
                writer.write_block('voltage', 10 * number, 1e-5, values[10 * number:][:10])
            shutil.move(part / 'part_0.mcap', directory / f'bag_{number}.mcap')
            shutil.rmtree(part)
        return values

    return write
