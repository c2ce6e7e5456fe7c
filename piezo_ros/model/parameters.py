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
Parameters declared once: name, default, unit, description and allowed range.

A parameter set is a frozen dataclass with fields made by `parameter`. Offline code builds it from a
mapping, nodes declare the same fields as ROS parameters, and both refuse the same values with the
same words.
"""

import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeVar

from piezo_ros.suggestions import did_you_mean, number_meant

__all__ = [
    'CHANGES',
    'Constraint',
    'ParameterError',
    'ParameterSet',
    'as_yaml',
    'constraint_of',
    'parameter',
]


_Set = TypeVar('_Set', bound='ParameterSet')
# When a node takes another value of a parameter, in words for its descriptor.
CHANGES = {
    'running': 'at once, also during a run',
    'activation': 'at the next activation; refused during a run',
    'configuration': 'when the node is configured: clean up first where it is already',
    'start': 'only as the process starts',
}


class ParameterError(ValueError):
    """A parameter that is unknown or out of range; the text names it, its value and the range."""


class Constraint(NamedTuple):
    """
    What a parameter means and which values it takes.

    Attributes
    ----------
    unit : str
        SI-style unit, '' for a pure number.
    description : str
        One sentence for people.
    minimum, maximum : float or None
        Inclusive bounds (of every element, for lists).
    choices : tuple of str
        The allowed texts, empty where any text will do.
    change : str
        When a node takes another value, one of `CHANGES`.

    """

    unit: str
    description: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    change: str = 'activation'


def parameter(
    default: Any,
    unit: str,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
    change: str = 'activation',
) -> Any:
    """
    Return a dataclass field that carries its own constraint.

    Parameters
    ----------
    default : bool, int, float, str or tuple of float
        The default; its type is the parameter's type.
    unit : str
        Unit of the number, '' for none.
    description : str
        One sentence.
    minimum, maximum : float, optional
        Inclusive bounds.
    choices : sequence of str, optional
        Allowed texts.
    change : str, optional
        When a node takes another value, one of `CHANGES`.

    """
    assert change in CHANGES
    constraint = Constraint(unit, description, minimum, maximum, tuple(choices), change)
    return dataclasses.field(default=default, metadata={'constraint': constraint})


def constraint_of(field: 'dataclasses.Field[Any]') -> Constraint:
    """Return the constraint of a field made with `parameter`."""
    constraint = field.metadata['constraint']
    assert isinstance(constraint, Constraint)
    return constraint


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParameterSet:
    """
    Base of every parameter set: checks each field, refuses what is unknown.

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True, kw_only=True)
    ... class Amplifier(ParameterSet):
    ...     gain: float = parameter(10.0, 'V/V', 'gain', minimum=0.0, maximum=100.0)
    >>> Amplifier.from_mapping({'gain': 5}).gain
    5.0
    >>> Amplifier.from_mapping({'gain': -1.0})
    Traceback (most recent call last):
    piezo_ros.model.parameters.ParameterError: gain is -1.0 V/V, allowed is 0 … 100 V/V

    """

    def __post_init__(self) -> None:
        self._check(vars(self))

    def _check(self, values: Mapping[str, Any]) -> None:
        """Convert, check and keep the values of some fields; then check all of them together."""
        own: Any = type(self)  # a type checker takes it for not hashable
        fields = _fields(own)
        for name, given in tuple(values.items()):
            field, kind, low, high, choices = fields[name]
            # Nearly all values are at once seen to be right; the others are looked at closely.
            value: Any = given
            is_kind = type(value) is kind
            if is_kind and (
                low <= value <= high if kind is float or kind is int
                else not value if kind is tuple else not choices or value in choices
            ):
                vars(self)[name] = value
                continue
            value = _converted(field, value)
            _check(name, value, constraint_of(field))
            vars(self)[name] = value
        self.check_together()

    def check_together(self) -> None:
        """Refuse combinations of values that are each allowed alone (default: none)."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of all parameters."""
        own: Any = cls
        return _names(own)

    @classmethod
    def among(cls: type[_Set], values: Mapping[str, Any]) -> _Set:
        """Build the set from the values that belong to it; the others are another set's."""
        known = cls.names()
        return cls(**{name: value for name, value in values.items() if name in known})

    @classmethod
    def from_mapping(cls: type[_Set], values: Mapping[str, Any]) -> _Set:
        """
        Build the set from names and values.

        Parameters
        ----------
        values : mapping of str to value
            Any subset of the parameters; the rest keeps its default.

        Raises
        ------
        ParameterError
            For an unknown name, a wrong type or a value out of range.

        """
        cls._check_names(values)
        return cls(**values)

    @classmethod
    def _check_names(cls, values: Mapping[str, Any]) -> None:
        names = cls.names()
        for name in values:
            if name not in names:
                raise ParameterError(
                    f'unknown parameter {name!r}; {cls.__name__} has {", ".join(names)}'
                    f'{did_you_mean(name, names)}')

    def replaced(self: _Set, **values: Any) -> _Set:
        """Return a copy with some values replaced, these checked, and all of them together."""
        self._check_names(values)
        copy = object.__new__(type(self))
        own = vars(self)
        # Checked already; a search replaces one value thousands of times.
        vars(copy).update({name: own[name] for name in self.names()})
        copy._check(values)
        return copy

    def to_mapping(self) -> dict[str, Any]:
        """Return names and values, lists for tuples, ready for YAML."""
        return {name: as_yaml(getattr(self, name)) for name in self.names()}


def as_yaml(value: Any) -> Any:
    """Return the value of a parameter as YAML has it: a list for a tuple."""
    return list(value) if isinstance(value, tuple) else value


@cache
def _fields(
    parameter_set: Any,
) -> dict[str, tuple['dataclasses.Field[Any]', type, float, float, tuple[str, ...]]]:
    """Return name to field, type, range (finite) and choices of each parameter of a set."""
    largest = sys.float_info.max
    found = {}
    for field in dataclasses.fields(parameter_set):
        _, _, low, high, choices, _ = constraint_of(field)
        found[field.name] = (
            field, type(field.default), -largest if low is None else low,
            largest if high is None else high, choices)
    return found


@cache
def _names(parameter_set: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(parameter_set))


def _converted(field: 'dataclasses.Field[Any]', value: Any) -> Any:
    """Return the value in the type of the default; YAML writes 1 where 1.0 is meant."""
    default = field.default
    number = _is_number(value)
    if isinstance(default, bool):
        valid = isinstance(value, bool)
    elif isinstance(default, int):
        valid = number and float(value).is_integer()
        value = int(value) if valid else value
    elif isinstance(default, float):
        valid = number
        value = float(value) if valid else value
    elif isinstance(default, tuple):
        value = value.tolist() if hasattr(value, 'tolist') else value  # numpy's and array.array
        valid = isinstance(value, list | tuple) and all(map(_is_number, value))
        value = tuple(map(float, value)) if valid else value
    else:
        valid = isinstance(value, str)
    if not valid:
        kind = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'text',
                tuple: 'a list of numbers'}[type(default)]
        meant = '' if isinstance(default, bool | str) else number_meant(
            value, constraint_of(field).unit)
        raise ParameterError(f'{field.name} is {value!r}, it must be {kind}{meant}')
    return value


def _is_number(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    # An integer may be larger than any float.
    return isinstance(value, float) or (
        isinstance(value, int) and abs(value) <= sys.float_info.max)


def _check(name: str, value: Any, constraint: Constraint) -> None:
    if constraint.choices and value not in constraint.choices:
        raise ParameterError(
            f'{name} is {value!r}, allowed are {", ".join(constraint.choices)}'
            f'{did_you_mean(value, constraint.choices)}')
    if isinstance(value, str | bool):
        return
    for number in value if isinstance(value, tuple) else (value,):
        low, high = constraint.minimum, constraint.maximum
        inside = (low is None or number >= low) and (high is None or number <= high)
        if not (math.isfinite(number) and inside):
            unit = f' {constraint.unit}' if constraint.unit else ''
            allowed = 'any finite number'
            if low is not None or high is not None:
                low_text = '-inf' if low is None else f'{low:g}'
                high_text = 'inf' if high is None else f'{high:g}'
                allowed = f'{low_text} … {high_text}'
            raise ParameterError(f'{name} is {number}{unit}, allowed is {allowed}{unit}')
