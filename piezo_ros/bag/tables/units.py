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

"""Units of measured columns: their factors, and the unit that the name of a column tells."""

import re
from typing import Final

__all__ = ['FACTORS', 'SENSOR_UNITS', 'TIME', 'unit_factor', 'unit_of_name', 'units_text']

TIME: Final = 's'

# Unit of a stream, or of time -> unit of a column -> how many of the former are one of the latter.
FACTORS: Final[dict[str, dict[str, float]]] = {
    TIME: {
        's': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'μs': 1e-6, 'ns': 1e-9, 'min': 60.0,
        'h': 3600.0},
    'v': {'V': 1.0, 'mV': 1e-3, 'uV': 1e-6, 'µV': 1e-6, 'μV': 1e-6, 'kV': 1e3},
    'um': {
        'um': 1.0, 'µm': 1.0, 'μm': 1.0, 'nm': 1e-3, 'pm': 1e-6, 'mm': 1e3, 'm': 1e6,
        'Å': 1e-4},
}
# What a displacement sensor may be read in; --scale then tells the micrometres per volt.
SENSOR_UNITS: Final = FACTORS['v']
_SEEN_ONCE: Final = ('µ', 'μ')  # two characters that look the same
_SUFFIX: Final = re.compile(r'.*[_ ]([A-Za-zµμÅ]+)')
_BRACKETED: Final = re.compile(r'.*[\[(]\s*([A-Za-zµμÅ]+)\s*[\])]\s*')
_OVER: Final = re.compile(r'.*/\s*([A-Za-zµμÅ]+)\s*')


def unit_factor(quantity: str, unit: str) -> float | None:
    """
    Return how many of the unit of a stream are one of another unit.

    Parameters
    ----------
    quantity : str
        Unit of the stream, ``'v'`` or ``'um'``, or ``'s'`` for time.
    unit : str
        The other unit, for instance ``'nm'``.

    Returns
    -------
    float or None
        The factor; None for a unit of something else.

    Examples
    --------
    >>> unit_factor('um', 'nm'), unit_factor('v', 'nm')
    (0.001, None)

    """
    return FACTORS[quantity].get(unit)


def units_text(quantity: str) -> str:
    """Return the units of a quantity as a list for a message."""
    units = [unit for unit in FACTORS[quantity] if not unit.startswith(_SEEN_ONCE)]
    if quantity == 'um':
        return f'{", ".join(units)}, or of a sensor V, mV'
    return ', '.join(units)


def unit_of_name(name: str) -> str | None:
    """
    Return the unit that the name of a column tells, None for none.

    Examples
    --------
    >>> [unit_of_name(name) for name in ('U [mV]', 'pos (nm)', 't / ms', 'voltage_v', 'U')]
    ['mV', 'nm', 'ms', 'V', None]

    """
    known = {unit: unit for units in FACTORS.values() for unit in units}
    for pattern in (_BRACKETED, _OVER):
        found = pattern.fullmatch(name)
        if found:
            return known.get(found[1], found[1])
    found = _SUFFIX.fullmatch(name)
    if found is None:
        return None
    # Behind an underscore units are written small: voltage_mv. x_m and U_h need not be units.
    small = {
        unit.lower(): unit for unit in reversed(tuple(known)) if unit not in ('m', 'h', 'min')}
    return small.get(found[1].lower())
