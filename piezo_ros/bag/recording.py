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

"""Runs that stay on the disk: read once to check them, then part by part as needed."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.container.mcap_file import McapFile
from piezo_ros.bag.contents import Contents, Facts, Span
from piezo_ros.bag.recorded_run import Run, Samples, check_part, missing_stream, run_of
from piezo_ros.bag.samples.run_choice import RunChoice
from piezo_ros.bag.samples.sinks import Collected, Extremes
from piezo_ros.bag.samples.stream_assembly import StreamAssembler
from piezo_ros.bag.topic_messages import messages_by_topic
from piezo_ros.streams import STREAMS

__all__ = ['Recording', 'StreamSummary', 'open_recording']


class StreamSummary(NamedTuple):
    """
    Summary of one stream.

    Attributes
    ----------
    start_index, samples : int
        Index of its first sample and their number, also of those that other streams lack.
    minimum, maximum : float
        Smallest and largest of them, in the stream's unit.
    topic : str
        Name of its topic.

    """

    start_index: int
    samples: int
    minimum: float
    maximum: float
    topic: str


@dataclass(frozen=True)
class Recording:
    """
    A run in a bag that is read in parts.

    The memory contains the part, a few chunks of the file, and a hundred bytes for each chunk,
    however long the run is.

    Attributes
    ----------
    path : Path
        The bag.
    facts : Facts
        Everything but the samples.

    """

    path: Path
    facts: Facts[Extremes]
    _spans: Mapping[Path, Mapping[int, Span]]
    _files: Mapping[Path, McapFile]
    _keep_not_finite: bool
    _choice: RunChoice | None
    _fill_gaps: bool = False

    @property
    def namespace(self) -> str:
        """Namespace of the rig, '/' for the root."""
        return self.facts.namespace

    @property
    def sample_period_s(self) -> float:
        """Sample period, seconds."""
        return self.facts.sample_period_s

    @property
    def start_index(self) -> int:
        """Index of the first sample that all streams have."""
        return self.facts.start_index

    @property
    def samples(self) -> int:
        """Number of samples from there on that all streams have."""
        return self.facts.samples

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Node name, as in the attached parameter file, to its parameters."""
        return self.facts.parameters

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata record 'piezo_ros'; empty for a foreign recording."""
        return self.facts.metadata

    @property
    def lost(self) -> tuple[str, ...]:
        """Sentences that name the losses, as `Run.lost`."""
        return self.facts.lost

    @property
    def streams(self) -> dict[str, StreamSummary]:
        """The streams that have samples, in the order of `STREAMS`."""
        return {
            stream: StreamSummary(
                assembler.start_index, assembler.count, extremes.minimum, extremes.maximum,
                self.facts.stream_topics[stream])
            for stream, (assembler, extremes) in self.facts.streams.items()}

    def uneven(self) -> tuple[str, ...]:
        """
        Return sentences that say which samples of which stream other streams have.

        The displacement is measured once more after the last voltage.
        """
        streams = {name: assembler for name, (assembler, _) in self.facts.streams.items()}
        ends = {name: each.start_index + each.count for name, each in streams.items()}
        first = min(each.start_index for each in streams.values())
        steps = max(end - (name == 'displacement') for name, end in ends.items())
        complete = any(each.ended for name, each in streams.items() if name != 'displacement')
        sentences = []
        for name, each in streams.items():
            if each.start_index > first:
                sentences.append(_missing(name, first, each.start_index))
            # A recorder that is stopped early, or a foreign rig, need not measure once more.
            once_more = name == 'displacement' and complete and not each.ended
            if ends[name] < steps + once_more:
                sentences.append(_missing(name, ends[name], steps + (name == 'displacement')))
        return tuple(sentences)

    def described(self, metadata: Mapping[str, str]) -> 'Recording':
        """Return the recording with other metadata, for bags that have none."""
        return replace(self, facts=replace(self.facts, metadata=dict(metadata)))

    def part(
        self, start: int, stop: int, *, every: int = 1, streams: Collection[str] | None = None,
    ) -> Run:
        """
        Read some of the aligned samples.

        Parameters
        ----------
        start, stop : int
            Half-open range among the `samples` aligned ones, counted from 0.
        every : int, optional
            Take one of so many samples, those with an index that it divides. The sample period of
            the run is longer by that factor, and its indices are divided by it.
        streams : collection of str, optional
            Which streams to read; all by default.

        Raises
        ------
        ValueError
            If the range is empty or leaves the samples, or ``every`` leaves nothing of it.
        BagError
            If there is no such stream, or the files have changed.

        """
        check_part(start, stop, self.samples)
        first, last = self.start_index + start, self.start_index + stop
        first += -first % every
        kept = range(first, last, every)
        if not kept:
            raise ValueError(f'the part {start} … {stop} has no index that {every} divides')
        wanted = tuple(self.facts.streams) if streams is None else tuple(streams)
        for stream in wanted:
            if stream not in self.facts.streams:
                raise missing_stream(
                    self.path, stream, self.namespace, self.facts.topics, self.facts.unlike)
        sinks = {stream: Collected(kept) for stream in wanted}
        self._read(sinks, kept)
        samples = {stream: sinks[stream].samples() for stream in STREAMS if stream in sinks}
        if any(values.size != len(kept) for values in samples.values()):
            raise BagError(f'{self.path} has changed since it was opened')
        period_s = self.sample_period_s * every
        return run_of(
            self.path, self.facts,
            {stream: Samples(first // every, values) for stream, values in samples.items()},
            start_index=first // every, samples=len(kept), sample_period_s=period_s)

    def pieces(self, samples: int = 1_000_000) -> Iterator[Run]:
        """
        Read all aligned samples, piece by piece.

        Parameters
        ----------
        samples : int, optional
            The most in one piece.

        Yields
        ------
        Run
            The pieces, in order; together they are the run.

        """
        for start in range(0, self.samples, samples):
            yield self.part(start, min(start + samples, self.samples))

    def _read(self, sinks: Mapping[str, Collected], kept: range) -> None:
        """Hand samples to the sinks, from those pieces of the files that contain them."""
        assemblers = {
            topic: StreamAssembler(
                stream, sink, keep_not_finite=self._keep_not_finite,
                sample_period_s=self.sample_period_s, fill_gaps=self._fill_gaps,
                start_index=self._first_needed(topic, kept) if self._fill_gaps else None)
            for stream, sink in sinks.items()
            for topic in (self.facts.stream_topics[stream],)}
        for path, spans in self._spans.items():
            needed = {
                position: topics for position, span in spans.items()
                if (topics := self._needed(span, assemblers, kept))}
            if not needed:
                continue
            surveyed = self._files[path]
            file = McapFile(path, surveyed)  # channels may be in a piece that is not read again
            for piece in file.pieces(needed):
                for topic, messages in messages_by_topic(file, piece).items():
                    if topic not in needed.get(piece.position, ()):
                        continue
                    if self._choice:
                        messages = self._choice.choose_again(path, piece, topic, messages)
                    assemblers[topic].add(piece, messages)

    def _first_needed(self, topic: str, kept: range) -> int | None:
        """Return the first index that the pieces with wanted samples of a topic begin with."""
        return min((
            span[topic][0] for spans in self._spans.values() for span in spans.values()
            if topic in self._needed(span, (topic,), kept)), default=None)

    @staticmethod
    def _needed(span: Span, topics: Collection[str], kept: range) -> frozenset[str]:
        """
        Return the topics of which a piece contains wanted samples.

        The samples of a topic are contiguous over these pieces, as `StreamAssembler` needs it.
        """
        return frozenset(
            topic for topic, (first, stop) in span.items()
            if topic in topics and first < kept.stop and stop > kept.start)


def _missing(stream: str, start: int, stop: int) -> str:
    return (
        f'samples {start} … {stop - 1} of stream {stream!r} are missing, by the length of the '
        f'other streams ({stop - start} samples)')


def open_recording(
    path: Path | str, *, namespace: str | None = None, allow_loss: bool = False,
    keep_not_finite: bool = False, fill_gaps: bool = False, run: int | None = None,
) -> Recording:
    """
    Open a run that may be larger than the memory: all of it is checked, no sample is kept.

    Parameters
    ----------
    path, namespace, allow_loss, keep_not_finite, run
        As `read` takes them.
    fill_gaps : bool, optional
        Whether samples that are missing in the middle of a stream are NaN, and told in `lost`;
        by default a stream ends at its first gap. NaN and infinite samples are kept then, too.

    Returns
    -------
    Recording
        The run.

    Raises
    ------
    BagError
        As `read`.

    """
    path = Path(path)
    contents = Contents(
        path, Extremes, keep_not_finite=keep_not_finite, fill_gaps=fill_gaps, run=run)
    return Recording(
        path, contents.facts(namespace, allow_loss=allow_loss), contents.spans, contents.files,
        keep_not_finite or fill_gaps, contents.choice, fill_gaps)
