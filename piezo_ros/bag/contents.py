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

"""Content of the files of a bag: streams by rig, metadata, parameters, damage."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from mcap.records import Attachment, Metadata

from piezo_ros.bag.bag_error import BagError
from piezo_ros.bag.container.chunk_scan import HEAD_BYTES, MESSAGE_HEAD_BYTES, unaligned
from piezo_ros.bag.container.mcap_file import McapFile, Piece
from piezo_ros.bag.container.rosbag2_files import BagFiles, bag_files
from piezo_ros.bag.description import (
    LOST_KEY,
    intact_records,
    recorded_metadata,
    recorded_parameters,
)
from piezo_ros.bag.recorded_topics import Place, Rigs, named_topics, unlike_stream, unlike_words
from piezo_ros.bag.samples.run_choice import RunChoice
from piezo_ros.bag.samples.sinks import Sink
from piezo_ros.bag.samples.stream_assembly import StreamAssembler, same_period
from piezo_ros.bag.topic_messages import MessageCounts, messages_by_topic
from piezo_ros.streams import STREAMS, labelled_stream
from piezo_ros.streams.message_type import TYPE_NAME

__all__ = ['Contents', 'Facts', 'Span']

_Sink = TypeVar('_Sink', bound=Sink)
# Topic -> first index and end of its samples in one piece.
Span = dict[str, tuple[int, int]]


# No NamedTuple: Python 3.10 has none that is generic.
@dataclass(frozen=True)
class Facts(Generic[_Sink]):
    """
    Everything that is known of a run in a bag, apart from its samples.

    Attributes
    ----------
    namespace : str
        Namespace of the rig, '/' for the root.
    sample_period_s : float
        Sample period, seconds.
    start_index, samples : int
        Index of the first sample that all streams have, and their number from there on.
    streams : dict of str to (StreamAssembler, sink)
        The streams that have samples, in the order of `STREAMS`.
    parameters : dict
        Node name, as in the attached parameter file, to its parameters.
    metadata : dict of str to str
        The metadata record 'piezo_ros'; empty for a foreign recording.
    lost : tuple of str
        Sentences that say what is missing.
    topics : tuple of str
        Names of all topics in the bag.
    stream_topics : dict of str to str
        The topic of each of the streams.
    unlike : dict of str to str
        Topic with the name of a stream to why it is none.

    """

    namespace: str
    sample_period_s: float
    start_index: int
    samples: int
    streams: dict[str, tuple[StreamAssembler, _Sink]]
    parameters: dict[str, dict[str, Any]]
    metadata: dict[str, str]
    lost: tuple[str, ...]
    topics: tuple[str, ...]
    stream_topics: dict[str, str]
    unlike: dict[str, str]


class Contents(Generic[_Sink]):
    """
    The content of a bag, read file by file; the samples go to sinks.

    Parameters
    ----------
    path : Path
        The bag.
    sink : callable
        Makes the sink of a stream when its first message comes.
    keep_not_finite : bool, optional
        Whether samples that are NaN or infinite are in order.
    fill_gaps : bool, optional
        Whether samples that are missing between two blocks are NaN.
    run : int, optional
        Which run to read where the streams have several, counted from 1.

    Attributes
    ----------
    spans : dict of Path to dict of int to Span
        The samples in each piece of each file, by the position of the piece.
    files : dict of Path to McapFile
        The files that were read.
    choice : RunChoice or None
        Which messages belong to the run, if one was asked for.

    Raises
    ------
    BagError
        If the bag cannot be read.

    """

    def __init__(
        self, path: Path, sink: Callable[[], _Sink], *, keep_not_finite: bool = False,
        fill_gaps: bool = False, run: int | None = None,
    ) -> None:
        self._path = path
        self._sink = sink
        self._run = run
        self._keep_not_finite = keep_not_finite or fill_gaps
        self._fill_gaps = fill_gaps
        files = bag_files(path)
        self._named: dict[str, Place] = {}
        self.files: dict[Path, McapFile] = {}
        self._read(files)
        named = named_topics(self._metadata)
        misnamed = any(
            self._kinds.get(topic, stream) != stream for topic, (_, stream) in named.items())
        if misnamed or self._counts.early():
            # The record came behind messages on topics with the name of another stream, as in a
            # bag that another program has converted; or that of a channel behind its messages.
            self._named = named
            self._read(files)
        self._rigs = Rigs(
            {topic: assembler.stream for topic, (assembler, _) in self._streams.items()},
            {**named_topics(self._metadata), **self._named})

    def _read(self, files: BagFiles) -> None:
        """Read all files, from the first on; the second time with the channels that are known."""
        known = self.files
        self._metadata: list[Metadata] = []
        self._attachments: list[Attachment] = []
        self._damage = list(files.lost)
        self._counts = MessageCounts()
        self._unlike: dict[str, str] = {}
        self._topics: set[str] = set()
        self._kinds: dict[str, str | None] = {}  # topic -> its stream, None if it is none
        self._streams: dict[str, tuple[StreamAssembler, _Sink]] = {}  # by topic
        self.choice = None if self._run is None else RunChoice(self._run)
        self.spans: dict[Path, dict[int, Span]] = {}
        self.files = {}
        for path in files.paths:
            self._add(McapFile(path, known.get(path)))
        self._damage += [*self._counts.nameless(), *self._counts.missing(files.messages)]

    def _add(self, file: McapFile) -> None:
        path = file.path
        self.files[path] = file
        self._counts.begin(file)
        self.spans[path] = {
            piece.position: self._take(file, piece) for piece in file.pieces()}
        self._topics.update(channel.topic for channel in file.channels.values())
        self._unlike.update(
            (channel.topic, why) for channel in file.channels.values()
            if (why := unlike_stream(file.schemas, channel)) is not None)
        intact, lost = intact_records(file.metadata)
        self._metadata += intact
        self._attachments += file.attachments
        self._damage += [*file.damage, *(f'{path.name}: {loss}' for loss in lost)]

    def _take(self, file: McapFile, piece: Piece) -> Span:
        """Hand the samples in a piece to their sinks and return which these are."""
        span: Span = {}
        for topic, messages in messages_by_topic(file, piece, self._counts).items():
            if topic not in self._kinds:
                self._kinds[topic] = self._kind(topic, file, piece, int(messages[0]))
            stream = self._kinds[topic]
            if stream is None:
                continue
            if topic not in self._streams:
                sink = self._sink()
                self._streams[topic] = StreamAssembler(
                    stream, sink, keep_not_finite=self._keep_not_finite,
                    fill_gaps=self._fill_gaps), sink
            assembler, _ = self._streams[topic]
            before = assembler.count
            if self.choice:
                messages = self.choice.choose(file.path, piece, topic, stream, messages)
            assembler.add(piece, messages)
            if assembler.count > before:
                first = assembler.start_index
                span[topic] = first + before, first + assembler.count
        return span

    def _kind(self, topic: str, file: McapFile, piece: Piece, start: int) -> str | None:
        """Return the stream of a topic: by the record, its name or the label of its first block."""
        intact, _ = intact_records(file.metadata)
        named = {**named_topics([*self._metadata, *intact]), **self._named}
        if topic in named:
            return named[topic].stream
        last = topic.rpartition('/')[2]
        if last in STREAMS:
            return last
        length = int(unaligned(piece.data, '<u8')[start + 1])
        return labelled_stream(piece.data[start + MESSAGE_HEAD_BYTES:start + HEAD_BYTES + length])

    def problems(self) -> list[str]:
        """Return what is wrong with the streams of all rigs."""
        return [
            assembler.loss for assembler, _ in self._streams.values() if assembler.loss is not None]

    def facts(self, namespace: str | None, *, allow_loss: bool) -> Facts[_Sink]:
        """
        Return all that is known of the streams of one rig.

        Parameters
        ----------
        namespace : str or None
            Namespace of the rig; needed only where several rigs are in the bag.
        allow_loss : bool
            Whether to accept a damaged bag, as far as it is whole.

        Raises
        ------
        BagError
            If the bag has another format version, no stream or several rigs, or is damaged.

        """
        path = self._path
        if self._damage and not allow_loss:
            raise BagError(
                f'{path} is damaged: {"; ".join(self._damage)}. `piezo bag salvage {path}` '
                'recovers what is whole')
        metadata = recorded_metadata(path, self._metadata)
        chosen = self._namespace(namespace)
        topics = self._stream_topics(chosen)
        found = {stream: self._streams[topic] for stream, topic in topics.items()}
        if self.choice:
            self.choice.check(path, topics.values())
        problems = [
            assembler.loss for assembler, _ in found.values() if assembler.loss is not None]
        if problems and not allow_loss:
            raise BagError(f'{path}: {"; ".join(problems)}')
        streams = {stream: pair for stream, pair in found.items() if pair[0].count}
        assemblers = {stream: assembler for stream, (assembler, _) in streams.items()}
        start, stop, period_s = _common(path, assemblers, problems)
        return Facts(
            chosen, period_s, start, stop - start, streams,
            recorded_parameters(path, self._attachments), metadata,
            (*metadata.get(LOST_KEY, '').splitlines(), *self._damage, *problems),
            tuple(sorted(self._topics)), {stream: topics[stream] for stream in streams},
            self._unlike)

    def _namespace(self, wanted: str | None) -> str:
        """Return the namespace to read."""
        rigs = self._rigs
        if not rigs.topics:
            topics = ', '.join(sorted(self._topics)) or 'none'
            raise BagError(
                f'{self._path} has no stream: no messages of type {TYPE_NAME} on a topic that '
                f'ends in one of {", ".join(STREAMS)} or labelled as one; its topics are '
                f'{topics}{unlike_words(self._unlike)}')
        if wanted is not None:
            name = '/' + wanted.strip('/')
            if name not in rigs.topics:
                raise BagError(
                    f'{self._path} has no stream in the namespace {name}, choices are '
                    f'{", ".join(sorted(rigs.topics))}')
            return name
        if len(rigs.choices) > 1:
            labelled = ', '.join(
                f'{topic} ({self._kinds[topic]})' for topic in sorted(rigs.labelled))
            raise BagError(
                f'{self._path} has streams in several namespaces, say which: '
                f'{", ".join(sorted(rigs.choices))}'
                + (f'; the names do not tell the rig of these: {labelled}' if labelled else ''))
        return rigs.choices[0]

    def _stream_topics(self, namespace: str) -> dict[str, str]:
        """Return the topics of the streams of a rig, in the order of `STREAMS`."""
        rig = self._rigs.topics[namespace]
        for stream, topics in rig.items():
            if len(topics) > 1:
                raise BagError(
                    f'{self._path} has the stream {stream!r} of the namespace {namespace} on '
                    f'several topics, only one of them may be in the bag: '
                    f'{", ".join(sorted(topics))}')
        return {stream: rig[stream][0] for stream in STREAMS if stream in rig}


def _common(
    path: Path, streams: dict[str, StreamAssembler], problems: list[str],
) -> tuple[int, int, float]:
    """Return the first index and the end of the common samples, and their period."""
    if not streams:
        raise BagError(f'{path} has no sample{"; ".join(["", *problems])}')
    (first_name, first), *others = streams.items()
    for name, stream in others:
        if not same_period(first.sample_period_s, stream.sample_period_s):
            raise BagError(
                f'{path}: the sample period of stream {name!r} is {stream.sample_period_s} s, '
                f'that of {first_name!r} is {first.sample_period_s} s')
    start = max(stream.start_index for stream in streams.values())
    stop = min(stream.start_index + stream.count for stream in streams.values())
    if stop <= start:
        ranges = ', '.join(
            f'{name} {stream.start_index} … {stream.start_index + stream.count - 1}'
            for name, stream in streams.items())
        raise BagError(f'{path}: no sample is common to all streams: {ranges}')
    return start, stop, first.sample_period_s
