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

"""The streams of one run as arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.contents import Facts
from piezo_ros.bag.recorded_topics import unlike_words

__all__ = ['Run', 'Samples', 'check_part', 'missing_stream', 'run_of']


class Samples(NamedTuple):
    """
    Consecutive samples of one stream.

    Attributes
    ----------
    start_index : int
        Index of the first sample.
    values : ndarray of float64, shape (n,)
        The samples, in the stream's unit.

    """

    start_index: int
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """
    The streams of one run, aligned by index.

    Attributes
    ----------
    path : Path
        The bag.
    namespace : str
        Namespace of the rig, '/' for the root.
    sample_period_s : float
        Sample period, seconds.
    start_index : int
        Index of the first sample that all streams have.
    samples : int
        Number of samples from there on that all streams have.
    parameters : dict
        Node name, as in the attached parameter file, to its parameters.
    metadata : dict of str to str
        The metadata record 'piezo_ros'; empty for a foreign recording.
    lost : tuple of str
        Sentences that name the losses; empty unless losses were allowed or the bag came from
        `salvage`.
    topics : tuple of str
        Names of all topics in the bag.
    unlike : mapping of str to str
        Topic with the name of a stream to why it is none.

    """

    path: Path
    namespace: str
    sample_period_s: float
    start_index: int
    samples: int
    parameters: dict[str, dict[str, Any]]
    metadata: dict[str, str]
    lost: tuple[str, ...]
    topics: tuple[str, ...]
    _streams: Mapping[str, Samples] = field(repr=False)
    unlike: Mapping[str, str] = field(default_factory=dict, repr=False)

    @property
    def streams(self) -> tuple[str, ...]:
        """The streams in this run that have samples, in the order of `STREAMS`."""
        return tuple(self._streams)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Times of the aligned samples, index times sample period, seconds, shape (samples,)."""
        indices = np.arange(self.start_index, self.start_index + self.samples, dtype=np.float64)
        return indices * self.sample_period_s

    @property
    def reference_um(self) -> NDArray[np.float64]:
        """Desired displacement, µm, shape (samples,)."""
        return self._aligned('reference')

    @property
    def feedforward_um(self) -> NDArray[np.float64]:
        """Feedforward command, µm, shape (samples,)."""
        return self._aligned('feedforward')

    @property
    def command_um(self) -> NDArray[np.float64]:
        """Linearised command, µm, shape (samples,)."""
        return self._aligned('command')

    @property
    def voltage_v(self) -> NDArray[np.float64]:
        """Amplifier input, V, shape (samples,)."""
        return self._aligned('voltage')

    @property
    def displacement_um(self) -> NDArray[np.float64]:
        """Measured displacement, µm, shape (samples,)."""
        return self._aligned('displacement')

    def whole(self, stream: str) -> tuple[int, NDArray[np.float64]]:
        """
        Return all samples of one stream, also those that other streams lack.

        Parameters
        ----------
        stream : str
            One of `streams`.

        Returns
        -------
        start_index : int
            Index of the first sample.
        samples : ndarray of float64, shape (n,)
            The samples, in the stream's unit.

        Raises
        ------
        BagError
            If the run has no such stream.

        """
        if stream not in self._streams:
            raise missing_stream(
                self.path, stream, self.namespace, self.topics, self.unlike)
        return self._streams[stream]

    def _aligned(self, stream: str) -> NDArray[np.float64]:
        start, samples = self.whole(stream)
        first = self.start_index - start
        return samples[first:first + self.samples]

    def not_finite(self) -> tuple[str, ...]:
        """Return a sentence for each stream with samples that are NaN or infinite."""
        sentences = []
        for stream in self.streams:
            values = self._aligned(stream)
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                first = int(bad[0])
                sentences.append(
                    f'sample {self.start_index + first} of stream {stream!r} is {values[first]}, '
                    f'it must be finite; {bad.size} of {values.size} samples of this stream are '
                    'not')
        return tuple(sentences)

    def part(self, start: int, stop: int) -> 'Run':
        """
        Return some of the aligned samples.

        Parameters
        ----------
        start, stop : int
            Half-open range among the `samples` aligned ones, counted from 0.

        Raises
        ------
        ValueError
            If the range is empty or leaves the samples.

        """
        check_part(start, stop, self.samples)
        first = self.start_index + start
        return replace(
            self, start_index=first, samples=stop - start,
            _streams={
                stream: Samples(first, self._aligned(stream)[start:stop])
                for stream in self.streams})


    def with_stream(self, stream: str, samples: ArrayLike) -> 'Run':
        """
        Return the run with other samples of one stream.

        Parameters
        ----------
        stream : str
            Its name, for instance ``'displacement'``.
        samples : array_like, shape (samples,)
            In the unit of the stream.

        Raises
        ------
        ValueError
            If the number of samples is another one.

        """
        values = np.asarray(samples, dtype=np.float64)
        if values.shape != (self.samples,):
            raise ValueError(
                f'samples of {stream!r} have the shape {values.shape}, allowed is '
                f'({self.samples},)')
        return replace(
            self, _streams={**self._streams, stream: Samples(self.start_index, values)})


def run_of(
    path: Path, facts: Facts[Any], streams: Mapping[str, Samples], *,
    start_index: int | None = None, samples: int | None = None,
    sample_period_s: float | None = None,
) -> Run:
    """
    Return the run in a bag, or a part of it.

    Parameters
    ----------
    path : Path
        The bag.
    facts : Facts
        Everything but the samples.
    streams : mapping of str to Samples
        The samples.
    start_index, samples, sample_period_s : optional
        Those of the part; by default those of the whole run.

    """
    return Run(
        path=path, namespace=facts.namespace,
        sample_period_s=sample_period_s or facts.sample_period_s,
        start_index=facts.start_index if start_index is None else start_index,
        samples=facts.samples if samples is None else samples,
        parameters=facts.parameters, metadata=facts.metadata, topics=facts.topics,
        _streams=streams, lost=facts.lost, unlike=facts.unlike)


def missing_stream(
    path: Path, stream: str, namespace: str, topics: tuple[str, ...],
    unlike: Mapping[str, str],
) -> BagError:
    """Return the error that a run lacks a stream."""
    return BagError(
        f'{path} has no samples of the stream {stream!r} in the namespace {namespace}; its topics '
        f'are {", ".join(topics)}{unlike_words(unlike)}')


def check_part(start: int, stop: int, samples: int) -> None:
    """Refuse a range that is empty or leaves the samples."""
    if not 0 <= start < stop <= samples:
        raise ValueError(
            f'the part {start} … {stop} of {samples} samples is empty or outside of them')
