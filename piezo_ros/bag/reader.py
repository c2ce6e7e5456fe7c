"""Reading of the streams of a run from a bag, whoever recorded it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from mcap.records import Attachment, Metadata
from numpy.typing import NDArray

from piezo_ros.bag.block import STREAMS
from piezo_ros.bag.chunk_scan import unaligned
from piezo_ros.bag.container import McapFile, Piece
from piezo_ros.bag.errors import BagError
from piezo_ros.bag.layout import mcap_files
from piezo_ros.bag.message_type import TYPE_NAME
from piezo_ros.bag.stream import Stream, StreamAssembler
from piezo_ros.bag.writer import FORMAT_VERSION, PARAMETERS_NAME, RECORD_NAME

__all__ = ['LOST_KEY', 'Run', 'read']

LOST_KEY: Final = 'lost'  # entry of the metadata record in which a salvaged bag names its losses
_CHANNEL_OFFSET: Final = 9


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
        Sentences that say what is missing; empty unless losses were allowed or the bag came from
        `salvage`.
    topics : tuple of str
        Names of all topics in the bag.

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
    _streams: Mapping[str, Stream] = field(repr=False)

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
            raise BagError(
                f'{self.path} has no samples of the stream {stream!r} in the namespace '
                f'{self.namespace}; its topics are {", ".join(self.topics)}')
        return self._streams[stream].start_index, self._streams[stream].samples

    def _aligned(self, stream: str) -> NDArray[np.float64]:
        start, samples = self.whole(stream)
        first = self.start_index - start
        return samples[first:first + self.samples]


def read(
    path: Path | str, *, namespace: str | None = None, allow_loss: bool = False,
    keep_not_finite: bool = False,
) -> Run:
    """
    Read the streams of one run from a bag.

    A stream is a topic of type ``std_msgs/msg/Float64MultiArray`` whose last name component is one
    of `STREAMS`; all other topics are ignored. Log times are not used.

    Parameters
    ----------
    path : Path or str
        A rosbag2 directory with MCAP storage, or one MCAP file.
    namespace : str, optional
        Namespace of the rig; needed only where several rigs are in the bag.
    allow_loss : bool, optional
        Whether to keep the whole leading part of a damaged bag; what is lost is then named in
        `Run.lost`. By default a damaged bag is refused.
    keep_not_finite : bool, optional
        Whether samples that are NaN or infinite belong to the run, for who can leave them out;
        else they are damage.

    Returns
    -------
    Run
        The run.

    Raises
    ------
    BagError
        If the bag cannot be read, has another format version, no stream or several rigs, or is
        damaged: cut off, a gap or an overlap of indices, a changed sample period, a sample that
        is not finite.

    """
    path = Path(path)
    contents = _Contents(path)
    for file in mcap_files(path):
        contents.add(file)
    if contents.damage and not allow_loss:
        raise BagError(
            f'{path} is damaged: {"; ".join(contents.damage)}. `piezo bag salvage {path}` '
            'recovers what is whole')
    metadata = _record(path, contents.metadata)
    chosen = contents.namespace(namespace)
    found = {
        stream: result for stream in STREAMS
        if (assembler := contents.streams[chosen].get(stream)) and (
            result := assembler.result(keep_not_finite=keep_not_finite))
    }
    problems = [result.problem for result in found.values() if result.problem is not None]
    if problems and not allow_loss:
        raise BagError(f'{path}: {"; ".join(problems)}')
    streams = {stream: result for stream, result in found.items() if result.samples.size}
    start, stop, period_s = _common(path, streams, problems)
    return Run(
        path=path, namespace=chosen, sample_period_s=period_s, start_index=start,
        samples=stop - start, parameters=_parameters(path, contents.attachments),
        metadata=metadata, topics=tuple(sorted(contents.topics)), _streams=streams,
        lost=(*metadata.get(LOST_KEY, '').splitlines(), *contents.damage, *problems))


class _Contents:
    """What the files of one bag hold."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.damage: list[str] = []
        self.topics: set[str] = set()
        self.streams: dict[str, dict[str, StreamAssembler]] = {}

    def add(self, path: Path) -> None:
        """Read one file."""
        file = McapFile(path)
        for piece in file.pieces():
            self._take(file, piece)
        self.topics.update(channel.topic for channel in file.channels.values())
        self.metadata += file.metadata
        self.attachments += file.attachments
        self.damage += file.damage

    def _take(self, file: McapFile, piece: Piece) -> None:
        channels = unaligned(piece.data, '<u2')[piece.messages + _CHANNEL_OFFSET]
        for number in np.flatnonzero(np.bincount(channels)).tolist():
            assembler = self._assembler(file, number)
            if assembler is not None:
                assembler.add(piece, piece.messages[channels == number])

    def _assembler(self, file: McapFile, number: int) -> StreamAssembler | None:
        """Return where the messages of a channel belong, None if it is no stream."""
        channel = file.channels.get(number)
        if channel is None or channel.message_encoding != 'cdr':
            return None
        schema = file.schemas.get(channel.schema_id)
        parent, _, stream = channel.topic.rpartition('/')
        if schema is None or schema.name != TYPE_NAME or stream not in STREAMS:
            return None
        streams = self.streams.setdefault(parent or '/', {})
        return streams.setdefault(stream, StreamAssembler(stream))

    def namespace(self, wanted: str | None) -> str:
        """Return the namespace to read."""
        choices = ', '.join(sorted(self.streams))
        if not self.streams:
            topics = ', '.join(sorted(self.topics)) or 'none'
            raise BagError(
                f'{self._path} has no stream: no messages of type {TYPE_NAME} on a topic that '
                f'ends in one of {", ".join(STREAMS)}; its topics are {topics}')
        if wanted is not None:
            name = '/' + wanted.strip('/')
            if name not in self.streams:
                raise BagError(
                    f'{self._path} has no stream in the namespace {name}, choices are {choices}')
            return name
        if len(self.streams) > 1:
            raise BagError(
                f'{self._path} has streams in several namespaces, say which: {choices}')
        return next(iter(self.streams))


def _record(path: Path, records: list[Metadata]) -> dict[str, str]:
    """Return the metadata record of this package, checked; empty if there is none."""
    entries: dict[str, str] = {}
    for record in records:
        if record.name == RECORD_NAME:
            version = record.metadata.get('format_version')
            if version != FORMAT_VERSION:
                raise BagError(
                    f'{path} has the format_version {version!r}, this release reads '
                    f'{FORMAT_VERSION!r}')
            entries.update(record.metadata)
    return entries


def _parameters(path: Path, attachments: list[Attachment]) -> dict[str, dict[str, Any]]:
    """Return the attached parameters by node."""
    parameters: dict[str, dict[str, Any]] = {}
    for attachment in attachments:
        if attachment.name != PARAMETERS_NAME:
            continue
        try:
            nodes = yaml.load(attachment.data, getattr(yaml, 'CSafeLoader', yaml.SafeLoader)) or {}
            for node, content in nodes.items():
                parameters.setdefault(node, {}).update(content['ros__parameters'] or {})
        except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise BagError(
                f'{path}: the attachment {PARAMETERS_NAME} is no ROS parameter file '
                f'({error})') from error
    return parameters


def _common(
    path: Path, streams: Mapping[str, Stream], problems: list[str],
) -> tuple[int, int, float]:
    """Return the first index and the end of the common samples, and their period."""
    if not streams:
        raise BagError(f'{path} has no sample{"; ".join(["", *problems])}')
    (first_name, first), *others = streams.items()
    for name, stream in others:
        if stream.sample_period_s != first.sample_period_s:
            raise BagError(
                f'{path}: the sample period of stream {name!r} is {stream.sample_period_s} s, '
                f'that of {first_name!r} is {first.sample_period_s} s')
    start = max(stream.start_index for stream in streams.values())
    stop = min(stream.start_index + stream.samples.size for stream in streams.values())
    if stop <= start:
        ranges = ', '.join(
            f'{name} {stream.start_index} … {stream.start_index + stream.samples.size - 1}'
            for name, stream in streams.items())
        raise BagError(f'{path}: no sample is common to all streams: {ranges}')
    return start, stop, first.sample_period_s
