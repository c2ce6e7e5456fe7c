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

"""What an entry of a plan says in vain: keys without effect, and two values for one parameter."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from piezo_ros.control.waveform import EXCITATIONS
from piezo_ros.experiment.plan.run_entry import SHORT_KEYS
from piezo_ros.parameters.errors import PlanError

__all__ = ['refuse_two_values', 'refuse_without_effect']

_TRAJECTORY: Final = 'trajectory'
_CHANGES: Final = 'changes'
_VOLTAGE: Final = 'voltage'
# What takes part in no run of the bare actuator.
_OF_LOOP: Final = (
    'scheme', 'harmonics', 'amplitude_um', 'offset_um', 'compensator', 'controller')
_OF_BARE: Final = ('amplitude_v', 'offset_v')
# Key of a trajectory to the waveforms that it is for; every other key is for any waveform.
_WAVEFORMS: Final[Mapping[str, tuple[str, ...]]] = {
    'flyback_fraction': ('sawtooth',), 'stairs': ('staircase',), 'axis': ('lissajous', 'spiral'),
    'lissajous_cycles': ('lissajous',), 'lissajous_phase': ('lissajous',),
    'frequencies_hz': EXCITATIONS, 'dwell_s': ('stepped_sine',), 'settle_s': ('stepped_sine',)}


def refuse_two_values(where: str, entry: Mapping[str, Any]) -> None:
    """
    Refuse an entry with a short key and the same parameter in the mapping of its node.

    Parameters
    ----------
    where : str
        What the error begins with.
    entry : mapping of str to value
        The entry.

    Raises
    ------
    PlanError
        For the first such key.

    """
    for key, node in {**SHORT_KEYS, _CHANGES: 'controller'}.items():
        section = entry.get(node)
        if key in entry and isinstance(section, Mapping) and key in section:
            raise PlanError(
                f'{where}: {node}: {key} is {section[key]!r} and {key} beside it is '
                f'{entry[key]!r}; a run takes one of them, give it once')


def refuse_without_effect(
    where: str, base: Mapping[str, Any], combinations: Sequence[Mapping[str, Any]],
) -> None:
    """
    Refuse a key of an entry that has no effect in any of its runs; 0 asks for nothing.

    Parameters
    ----------
    where : str
        What the error begins with.
    base : mapping of str to value
        What the parameter files say of the trajectory.
    combinations : sequence of mapping
        The entry, once for each combination of its lists.

    Raises
    ------
    PlanError
        For the first such key; the text says why.

    """
    reasons: dict[str, list[str]] = {}
    for entry in combinations:
        own = entry.get(_TRAJECTORY, {})
        section = own if isinstance(own, Mapping) else {}
        told = {**base, **section, **entry}
        values = {**entry, **{f'{_TRAJECTORY}: {name}': value for name, value in section.items()}}
        for key, value in values.items():
            name = key.rpartition(' ')[2]
            reasons.setdefault(key, []).append(
                '' if value == 0 and not isinstance(value, bool) else _why_idle(
                    name, str(told.get('waveform', 'triangle')), told.get('output')))
    for key, why in reasons.items():
        if all(why):
            raise PlanError(f'{where}: {key} has no effect: {why[0]}')


def _why_idle(key: str, waveform: str, output: Any) -> str:
    """Return why a key has no effect, '' where it has one."""
    if output == _VOLTAGE and key in _OF_LOOP:
        instead = f', give {key[:-2]}v' if key.endswith('_um') else ''
        return f'output is voltage, which needs neither controller nor compensator{instead}'
    if output != _VOLTAGE and key in _OF_BARE:
        return f'it is for output voltage, give {key[:-1]}um'
    if waveform not in _WAVEFORMS.get(key, (waveform,)):
        return f'waveform is {waveform}, it is for {" and ".join(_WAVEFORMS[key])}'
    if key == 'ramp_periods' and waveform in EXCITATIONS:
        return f'waveform is {waveform}, which has a start of its own'
    return ''
