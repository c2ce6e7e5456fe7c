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
The place of the hysteresis in a parameter file of the dynamics.

The file lists the poles before the hysteresis first and says how many they are; of (6) in Liu 2015
pair 1 is the one before. So the lines of poles are put into this order, with what belongs to them,
such as their standard errors.

With poles before the hysteresis, the response that the dynamics were fitted to depends on the
amplitude, and the poles found in it are off by a few per cent. So where the place is decided, the
file gets the dynamics that were refined with the hysteresis in its place.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from piezo_ros.identification.place.hysteresis_place import HysteresisPlace
from piezo_ros.identification.yaml_text import yaml_list, yaml_number

__all__ = ['placed_parameter_yaml', 'undecided_parameter_yaml']

_LISTED: Final = {
    'pole_rates_rad_per_s': 'rates', 'pole_frequencies_rad_per_s': 'pairs',
    'pole_damping_ratios': 'pairs'}
_LINE: Final = re.compile(r'^( +)(\w+): ?(.*)$')
_HEADER: Final = '  ros__parameters:'


def placed_parameter_yaml(text: str, place: HysteresisPlace) -> str:
    """
    Return a parameter file of the dynamics with the place of the hysteresis.

    Parameters
    ----------
    text : str
        The file, one parameter a line.
    place : HysteresisPlace
        The place, for the poles in the order of the file.

    """
    order = {
        'rates': _first(place.rates_before, len(place.candidates[0].factors.rates_rad_per_s)),
        'pairs': _first(place.pairs_before, len(place.candidates[0].factors.pairs))}
    written = [
        f'    rates_before_hysteresis: {len(place.rates_before)}',
        f'    pairs_before_hysteresis: {len(place.pairs_before)}',
        f'    hysteresis_place: {"known" if place.is_decided else "undecided"}']
    refined = _refined(place, order, bool(re.search(r"dynamics: '?sections", text)))
    return '\n'.join([
        *_with_place(text, written, order, refined),
        *_facts(place, 'identified_dynamics' in text)]) + '\n'


def undecided_parameter_yaml(text: str) -> str:
    """Return a parameter file of the dynamics that says that the place is not known."""
    written = ['    hysteresis_place: undecided']
    return '\n'.join(_with_place(text, written, {}, {})) + '\n'


def _with_place(
    text: str, written: Sequence[str], order: Mapping[str, list[int]], refined: Mapping[str, str],
) -> list[str]:
    """Return the lines of a file with the poles in another order and with the place."""
    is_swapped = order.get('pairs') == [1, 0]
    replaced = {line.split(':')[0].strip() for line in written}
    lines: list[str] = []
    found = {
        match[2]: line for line in text.splitlines() if (match := _LINE.match(line))}
    for line in text.splitlines():
        match = _LINE.match(line)
        name = match[2] if match else ''
        if name in replaced:
            continue
        if name in refined:
            lines.append(f'    {name}: {refined[name]}  # refined with the hysteresis in its place')
            continue
        kind = next((
            kind for listed, kind in _LISTED.items() if name.startswith(listed)), None)
        if match and kind in order:
            line = f'{match[1]}{name}: {_permuted(match[3], order[str(kind)])}'
        elif match and is_swapped and _is_pair(name):
            other = _LINE.match(found[_twin(name)])
            assert other is not None
            line = f'{match[1]}{name}: {other[3]}'
        lines.append(line)
    at = lines.index(_HEADER) + 1
    end = next((
        i for i, line in enumerate(lines[at:], start=at) if not line.startswith('    ')),
        len(lines))
    lines[end:end] = written
    return lines


def _refined(
    place: HysteresisPlace, order: dict[str, list[int]], is_sections: bool,
) -> dict[str, str]:
    """Return the refined dynamics as values of the file, nothing where they are no better."""
    if not (place.is_decided and (place.rates_before or place.pairs_before)):
        return {}
    factors = place.candidates[0].factors
    rates = [factors.rates_rad_per_s[i] for i in order['rates']]
    pairs = [factors.pairs[i] for i in order['pairs']]
    frequencies, dampings = ([pair[i] for pair in pairs] for i in range(2))
    if is_sections:
        zero_rates, zero_pairs = _zeros(factors.zeros)
        return {
            'gain_um_per_um': yaml_number(factors.gain),
            'pole_rates_rad_per_s': yaml_list(rates),
            'pole_frequencies_rad_per_s': yaml_list(frequencies),
            'pole_damping_ratios': yaml_list(dampings),
            'zero_rates_rad_per_s': yaml_list(zero_rates),
            'zero_frequencies_rad_per_s': yaml_list(pair[0] for pair in zero_pairs),
            'zero_damping_ratios': yaml_list(pair[1] for pair in zero_pairs)}
    if len(factors.zeros) != 3 or not factors.zeros[2] > 0.0:
        return {}  # (6) has b2 > 0
    b2 = 1.0 / factors.zeros[2]
    values = {
        'gain_k_rad3_per_s3': (
            factors.gain * math.prod(frequencies)**2 * rates[0] / b2),
        'zero_b1_rad_per_s': factors.zeros[1] * b2,
        'zero_b2_rad2_per_s2': b2,
        'time_constant_s': 1.0 / rates[0]}
    for number, (frequency, damping) in enumerate(pairs, start=1):
        values[f'natural_frequency_{number}_rad_per_s'] = frequency
        values[f'damping_ratio_{number}'] = damping
    return {name: yaml_number(value) for name, value in values.items()}


def _zeros(
    coefficients: Sequence[float],
) -> tuple[list[float], list[tuple[float, float]]]:
    """Return the rates of the real zeros, and frequency and damping of the pairs."""
    roots = np.roots(coefficients[::-1])
    rates = [-float(root.real) for root in roots if root.imag == 0.0]
    pairs = [
        (float(abs(root)), -float(root.real / abs(root))) for root in roots if root.imag > 0.0]
    return rates, pairs


def _first(before: frozenset[int], count: int) -> list[int]:
    return [*sorted(before), *(i for i in range(count) if i not in before)]


def _permuted(value: str, order: Sequence[int]) -> str:
    inside, bracket, rest = value.removeprefix('[').partition(']')
    items = [item.strip() for item in inside.split(',')]
    if not bracket or len(items) != len(order):
        return value
    return '[' + ', '.join(items[i] for i in order) + ']' + rest


def _is_pair(name: str) -> bool:
    return bool(re.match(r'(natural_frequency|damping_ratio)_[12]', name))


def _twin(name: str) -> str:
    number = re.search(r'_([12])', name)
    assert number is not None
    return name[:number.start(1)] + ('2' if number[1] == '1' else '1') + name[number.end(1):]


def _facts(place: HysteresisPlace, has_section: bool) -> list[str]:
    """Return what was found, as lines of the section that nodes do not read."""
    best = place.candidates[0]
    percent = 100.0 * place.misfit_um / place.displacement_rms_um
    facts = [
        f'    place_misfit_um: {yaml_number(place.misfit_um)}',
        f'    place_misfit_percent: {yaml_number(percent)}',
        f'    place_spread_percent: {yaml_number(place.spread_percent)}',
        f'    place_candidates: [{", ".join(repr(str(each)) for each in place.candidates)}]',
        f'    place_refined_gain_um_per_um: {yaml_number(best.factors.gain)}']
    # The section, where there is one, ends the file.
    return facts if has_section else ['/**/identified_dynamics:', _HEADER, *facts]
