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
Changes of gains and scheme during a run, listed by the sample from which they apply.

What is listed is part of the run: live and offline it gives the same bits. A change is bumpless:
with feedback the integral is preset so that the command goes on from its last value. A scheme
without feedback has no integral, and its command takes its own value at once.
"""

import dataclasses
import itertools
import json
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from piezo_ros.control.controller_step import AUTO, ControllerParameters
from piezo_ros.model.parameters import ParameterError, ParameterSet, constraint_of, parameter

__all__ = [
    'CHANGEABLE',
    'Change',
    'ChangeParameters',
    'Segment',
    'changed_law',
    'changes_text',
    'parse_changes',
    'parse_entries',
    'segments',
    'without',
]

# The parameters of the controller that may change during a run.
CHANGEABLE = tuple(
    field.name for field in dataclasses.fields(ControllerParameters)
    if constraint_of(field).change == 'running')
_AT = 'at_sample'
# A lead needs both.
_ONLY_TOGETHER = ('lead_zero_hz', 'lead_pole_hz')
_LONGEST_SHOWN = 60  # characters of a refused text


@dataclass(frozen=True, kw_only=True)
class ChangeParameters(ParameterSet):
    """Which gains and which scheme apply from which sample on."""

    changes: str = parameter(
        '', '', 'changes during every run, a JSON list such as [{"at_sample": 5000, "scheme": '
        '"ff"}], by the index from the first sample of the run; empty for none')
    apply_at_sample: int = parameter(
        -1, '', 'sample at which gains and scheme take effect that the same atomic call sets '
        'during a run; -1: the next; holds for that call alone',
        minimum=-1, maximum=2**53, change='running')

    def check_together(self) -> None:
        """Refuse a list that cannot be read."""
        parse_changes(self.changes)


class Change(NamedTuple):
    """What changes at one sample."""

    at_sample: int
    values: dict[str, Any]


class Segment(NamedTuple):
    """Samples ``start`` to ``stop`` (exclusive) under one law."""

    start: int
    stop: int
    law: ControllerParameters


def parse_changes(text: str) -> tuple[Change, ...]:
    """
    Read a list of changes.

    Parameters
    ----------
    text : str
        JSON: a list of objects, each with ``at_sample`` and some of `CHANGEABLE`; '' for none.

    Returns
    -------
    tuple of Change
        In the order of their samples.

    Raises
    ------
    ParameterError
        If it is no such list, or a value is out of range.

    Examples
    --------
    >>> parse_changes('[{"at_sample": 5000, "scheme": "ff"}]')
    (Change(at_sample=5000, values={'scheme': 'ff'}),)

    """
    changes = []
    for at_sample, values in parse_entries('changes', text):
        for name in values:
            if name not in CHANGEABLE:
                raise ParameterError(
                    f'changes: {name} cannot change during a run; what can is '
                    f'{", ".join(CHANGEABLE)}')
        # Whether several values go together depends on the law that they change.
        for name, value in values.items():
            if name not in _ONLY_TOGETHER:
                changed_law(ControllerParameters(command_minimum_um=-1e4, command_maximum_um=1e4),
                            {name: value})
        changes.append(Change(at_sample, values))
    return tuple(changes)


def parse_entries(name: str, text: str) -> tuple[tuple[int, dict[str, Any]], ...]:
    """
    Read a list of what changes at samples of a run.

    Parameters
    ----------
    name : str
        Of the parameter, for errors.
    text : str
        JSON: a list of objects, each with ``at_sample`` and what changes there; '' for none.

    Returns
    -------
    tuple of (int, dict)
        Samples, ascending, and what changes there.

    Raises
    ------
    ParameterError
        If it is no such list.

    """
    if not text.strip():
        return ()
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ParameterError(f'{name} is {_shown(text)}, which is no JSON: {error}') from None
    if not isinstance(entries, list):
        raise ParameterError(f'{name} is {_shown(text)}, it must be a list')
    changes = [_entry(name, entry) for entry in entries]
    for earlier, later in itertools.pairwise(changes):
        if earlier[0] >= later[0]:
            raise ParameterError(
                f'{name} has at_sample {later[0]} after {earlier[0]}, the samples must ascend')
    return tuple(changes)


def _entry(name: str, entry: Any) -> tuple[int, dict[str, Any]]:
    if not isinstance(entry, Mapping):
        raise ParameterError(f'{name} has {entry!r}, it must be a mapping with {_AT}')
    at_sample = entry.get(_AT)
    if isinstance(at_sample, bool) or not isinstance(at_sample, int) or at_sample < 0:
        raise ParameterError(
            f'{name}: {_AT} is {at_sample!r}, it must be a sample, an integer from 0 on')
    values = {str(key): value for key, value in entry.items() if key != _AT}
    if not values:
        raise ParameterError(f'{name}: nothing changes at sample {at_sample}')
    return at_sample, values


def _shown(text: str) -> str:
    return repr(text if len(text) <= _LONGEST_SHOWN else f'{text[:_LONGEST_SHOWN]}…')


def changed_law(law: ControllerParameters, values: Mapping[str, Any]) -> ControllerParameters:
    """
    Return a law with some values changed.

    Raises
    ------
    ParameterError
        If the values do not go together, or the scheme is auto, which is decided before a run.

    """
    changed = law.replaced(**values)
    if changed.scheme == AUTO:
        raise ParameterError('scheme auto is decided before a run; a change names a scheme')
    return changed


def changes_text(entries: Iterable[Mapping[str, Any]]) -> str:
    """Return a list of changes as the parameter wants it."""
    entries = [dict(entry) for entry in entries]
    return json.dumps(entries) if entries else ''


def segments(
    law: ControllerParameters, changes: Sequence[Change], samples: int,
) -> list[Segment]:
    """
    Cut a run into pieces under one law each.

    Parameters
    ----------
    law : ControllerParameters
        What applies at the start.
    changes : sequence of Change
        In the order of their samples; those after the run are left out.
    samples : int
        Length of the run.

    Raises
    ------
    ParameterError
        If the values of a change do not go together.

    Examples
    --------
    >>> changes = parse_changes('[{"at_sample": 5000, "scheme": "ff"}]')
    >>> for piece in segments(ControllerParameters(scheme='fb'), changes, 8000):
    ...     print(piece.start, piece.stop, piece.law.scheme)
    0 5000 fb
    5000 8000 ff

    """
    starts = [0]
    laws = [law]
    for change in changes:
        law = changed_law(law, change.values)
        if change.at_sample >= samples:
            continue
        if change.at_sample == starts[-1]:
            laws[-1] = law
        else:
            starts.append(change.at_sample)
            laws.append(law)
    return [
        Segment(start, stop, piece)
        for start, stop, piece in zip(starts, [*starts[1:], samples], laws, strict=True)]


def without(changes: Sequence[Change], names: Container[str]) -> tuple[Change, ...]:
    """Return changes that leave some parameters alone."""
    kept = (
        Change(at_sample, {name: value for name, value in values.items() if name not in names})
        for at_sample, values in changes)
    return tuple(change for change in kept if change.values)
