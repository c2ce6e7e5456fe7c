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

"""Speed of writing and reading bags."""

import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.measurement import Measurement, Ratio, higher, seconds, shortest
from piezo_ros.bag import STREAMS, BagWriter, BlockCodec, read

__all__ = ['BAGS', 'BAG_RATIOS']

_PERIOD_S: Final = 1e-5
_SINGLE_SAMPLES: Final = 40_000  # of each stream, one for each message
_BLOCK_SAMPLES: Final = 1000
_MANY_SAMPLES: Final = 4_000_000  # of each stream, in blocks


@cache
def _messages(samples: int, block_samples: int) -> list[tuple[str, bytes]]:
    """Return stream and bytes of every message of a run, as a recorder receives them."""
    generator = np.random.default_rng(1)
    time_s = _PERIOD_S * np.arange(samples)
    values = {
        stream: np.sin(2.0 * np.pi * 300.0 * time_s) + generator.normal(0.0, 1e-3, samples)
        for stream in STREAMS}
    codecs = {stream: BlockCodec(stream) for stream in STREAMS}
    return [
        (stream, codecs[stream].encode(
            start, _PERIOD_S, values[stream][start:start + block_samples]))
        for start in range(0, samples, block_samples) for stream in STREAMS]


def _write(path: Path, messages: list[tuple[str, bytes]]) -> None:
    with BagWriter(path) as writer:
        for stream, raw in messages:
            writer.write(stream, raw)


def _write_and_read(
    samples: int, block_samples: int, counted: int,
) -> Callable[[], tuple[float, float]]:
    """Return a measurement: counted items written and samples read, per second."""
    def measure() -> tuple[float, float]:
        messages = _messages(samples, block_samples)
        with tempfile.TemporaryDirectory(prefix='piezo_bench_') as directory:
            path = Path(directory) / 'bag'
            write_seconds = seconds(lambda: _write(path, messages))
            os.sync()
            read_seconds = shortest(lambda: read(path))
        return counted / write_seconds, samples * len(STREAMS) / read_seconds
    return measure


BAGS: Final = (
    Measurement(
        'bag',
        (higher('bag_write_single', 'messages/s'), higher('bag_read_single', 'samples/s')),
        _write_and_read(_SINGLE_SAMPLES, 1, _SINGLE_SAMPLES * len(STREAMS))),
    Measurement(
        'bag',
        (higher('bag_write_blocks', 'samples/s'), higher('bag_read_blocks', 'samples/s')),
        _write_and_read(_MANY_SAMPLES, _BLOCK_SAMPLES, _MANY_SAMPLES * len(STREAMS))),
)
BAG_RATIOS: Final = (
    Ratio('bag_write_single_over_interpreter', 'bag_write_single', 'interpreter',
          higher_is_better=True),
    Ratio('bag_read_single_over_chain', 'bag_read_single', 'chain_rate', higher_is_better=True),
    Ratio('bag_read_blocks_over_chain', 'bag_read_blocks', 'chain_rate', higher_is_better=True),
)
