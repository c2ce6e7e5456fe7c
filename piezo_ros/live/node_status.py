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
Statuses of nodes, as a supervisor takes them: from the topic ``status``, which anyone may write.

A text that is no status is refused; it ends no run.
"""

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from piezo_ros.parameters.node_parameters import NODE_PARAMETERS

__all__ = ['BadStatusError', 'has_begun', 'parse_status', 'voltage_at_the_end']

# What a supervisor reads of a status: types, and what is assumed where a node says nothing.
_FIELDS: Final[dict[str, tuple[tuple[type, ...], Any]]] = {
    'node': ((str,), ''),
    'state': ((str,), ''),
    'index': ((int,), 0),
    'reason': ((str,), ''),
    'by_peer': ((bool,), False),
    'voltage_v': ((float, int, type(None)), None),
    'elapsed_s': ((float, int), 0.0),
}
_OVER: Final = ('finished', 'faulted', 'stopped', 'inactive', 'unconfigured')
_BEFORE_ITS_RUN: Final = ('', 'inactive', 'unconfigured')
_LARGEST: Final = 2**53  # of an integer: more is no index, and a float would round it
_SHOWN: Final = 60  # characters of a refused text


class BadStatusError(ValueError):
    """A text that is no status of a node."""


def parse_status(text: str) -> dict[str, Any]:
    """
    Return the status that a text is, with every field that a supervisor reads.

    Parameters
    ----------
    text : str
        JSON.

    Raises
    ------
    BadStatusError
        If it is not the status of a node of this package; the message names what is wrong.

    """
    shown = repr(text if len(text) <= _SHOWN else f'{text[:_SHOWN]}…')
    try:
        status = json.loads(text)
    except (ValueError, RecursionError):
        raise BadStatusError(f'{shown} is not JSON') from None
    if not isinstance(status, dict):
        raise BadStatusError(f'{shown} is not an object of JSON')
    for name, (types, default) in _FIELDS.items():
        value = status.setdefault(name, default)
        # bool is an int to Python.
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            raise BadStatusError(f'{name} is {value!r} in {shown}')
        if isinstance(value, float) and not math.isfinite(value):
            raise BadStatusError(f'{name} is {value} in {shown}, it must be finite')
        if isinstance(value, int) and abs(value) > _LARGEST:
            raise BadStatusError(f'{name} is no number of a node in {shown}')
    if status['node'] not in NODE_PARAMETERS:
        raise BadStatusError(
            f'node is {status["node"]!r} in {shown}, it must be one of '
            f'{", ".join(sorted(NODE_PARAMETERS))}')
    return status


def has_begun(status: Mapping[str, Any]) -> bool:
    """Return whether the run of a node has begun, by a status since it was started for it."""
    return status['state'] not in _BEFORE_ITS_RUN


def voltage_at_the_end(plant: Mapping[str, Any], *, killed: bool) -> list[str]:
    """
    Return what is known of the voltage once all processes have ended.

    Parameters
    ----------
    plant : mapping
        The newest status of the plant, empty where there was none.
    killed : bool
        Whether its process was killed: it has not ramped the voltage to zero then.

    Returns
    -------
    list of str
        A sentence, or nothing where the plant never had a voltage.

    """
    voltage_v = plant.get('voltage_v')
    if voltage_v is None and plant.get('voltage_before_v') is not None:
        return ['the voltage is unknown: the device does not tell what it holds any more']
    if voltage_v is None:
        return ['the voltage is unknown: the plant was killed before it said any'] if killed else []
    if killed or plant['state'] not in _OVER:
        last = f'{voltage_v:g} V at sample {plant["index"]}'
        return [f'the voltage is unknown: the last that the plant said is {last}']
    return [f'the voltage deviation is {voltage_v:g} V']
