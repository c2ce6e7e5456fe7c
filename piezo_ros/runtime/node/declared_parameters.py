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

"""Declares parameter sets as ROS parameters and reads them back, refusing what they refuse."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from piezo_ros.model.parameters import CHANGES, ParameterError, ParameterSet, constraint_of
from piezo_ros.runtime.node.rclpy_node.guard import explain

__all__ = ['declare', 'names_by_change', 'plain', 'read']

_Set = TypeVar('_Set', bound=ParameterSet)


def declare(
    node: Node, *sets: type[ParameterSet], defaults: Mapping[str, Any] | None = None,
    accept: Callable[[Mapping[str, Any]], str] = lambda changes: '',
) -> None:
    """
    Declare every parameter of some sets with description, range and unit.

    Parameters
    ----------
    node : Node
        Where to declare.
    *sets : type of ParameterSet
        The sets; a name that two of them share is declared once.
    defaults : mapping of str to value, optional
        Values for where the user sets none, in place of those of the sets.
    accept : callable, optional
        Is given the changes of one call that the sets allow, by name; what it returns is the reason
        to refuse them all, '' for none.

    """
    fields = {
        field.name: field for parameter_set in sets for field in dataclasses.fields(parameter_set)}
    given = node._parameter_overrides  # what command line and files say; rclpy has no other way
    for name, field in fields.items():
        if name in given:
            given[name] = _with_numbers(given[name], fields)
        default = (defaults or {}).get(name, field.default)
        node.declare_parameter(
            name, list(default) if isinstance(default, tuple) else default, _descriptor(field))
        if isinstance(default, tuple) and _is_empty(node.get_parameter(name).value):
            # An empty list is one of bytes for rclpy, unless its type is told.
            node.set_parameters([_empty_list(name)])
    node.add_pre_set_parameters_callback(
        lambda changes: [_with_numbers(change, fields) for change in changes])

    def check(changes: list[Parameter]) -> SetParametersResult:
        try:
            reason = _refusal(node, sets, changes) or accept({
                change.name: change.value for change in changes})
        except Exception as error:  # No caller catches it.
            reason = explain(error)
        return SetParametersResult(successful=not reason, reason=reason)

    node.add_on_set_parameters_callback(check)


def _with_numbers(
    change: Parameter, fields: 'Mapping[str, dataclasses.Field[Any]]',
) -> Parameter:
    """Return a value that YAML 1.1 takes for text, as it does 1e-5, as the number that is meant."""
    field = fields.get(change.name)
    if field is None or not isinstance(field.default, int | float | tuple):
        return change
    if isinstance(field.default, tuple) and _is_empty(change.value):
        return _empty_list(change.name)
    try:
        if isinstance(change.value, str):
            return Parameter(change.name, value=_number(change.value))
        if isinstance(change.value, list) and any(isinstance(item, str) for item in change.value):
            return Parameter(change.name, value=[float(item) for item in change.value])
    except ValueError:
        pass  # Text it is, and refused as that.
    return change


def _is_empty(value: Any) -> bool:
    """Return whether a list is empty; what a file or a command line gives as [] has no value."""
    return value is None or (not isinstance(value, str | int | float) and len(value) == 0)


def _empty_list(name: str) -> Parameter:
    return Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])


def _number(text: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        return float(text)


def read(node: Node, parameter_set: type[_Set]) -> _Set:
    """
    Return the present values of a set.

    Raises
    ------
    ParameterError
        If the values do not go together.

    """
    return parameter_set.from_mapping({
        field.name: node.get_parameter(field.name).value
        for field in dataclasses.fields(parameter_set)})


def names_by_change(*sets: type[ParameterSet]) -> dict[str, frozenset[str]]:
    """Return the names of the parameters that change at a time, for each of `CHANGES`."""
    constraints = {
        field.name: constraint_of(field)
        for parameter_set in sets for field in dataclasses.fields(parameter_set)}
    return {
        change: frozenset(
            name for name, constraint in constraints.items() if constraint.change == change)
        for change in CHANGES}


def plain(value: Any) -> Any:
    """Return the value of a parameter in types that YAML can write."""
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def _descriptor(field: 'dataclasses.Field[Any]') -> ParameterDescriptor:
    constraint = constraint_of(field)
    text = constraint.description
    if constraint.unit:
        text += f' [{constraint.unit}]'
    descriptor = ParameterDescriptor(
        name=field.name, description=text, read_only=constraint.change == 'start')
    when = f'takes effect {CHANGES[constraint.change]}'
    descriptor.additional_constraints = '; '.join([
        *(['one of ' + ', '.join(constraint.choices)] if constraint.choices else []), when])
    default, low, high = field.default, constraint.minimum, constraint.maximum
    if isinstance(default, bool | str | tuple):
        # A user may write whole numbers in a list of numbers; the set converts them.
        descriptor.dynamic_typing = isinstance(default, tuple)
    elif isinstance(default, int) and low is not None and high is not None:
        descriptor.integer_range = [
            IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    else:
        descriptor.dynamic_typing = True
        if low is not None and high is not None:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)]
    return descriptor


def _refusal(
    node: Node, sets: tuple[type[ParameterSet], ...], changes: list[Parameter],
) -> str:
    """Return why a set refuses the changes of one call, '' where none does."""
    new = {change.name: change.value for change in changes}
    for parameter_set in sets:
        names = [field.name for field in dataclasses.fields(parameter_set)]
        if not new.keys() & set(names) or not all(node.has_parameter(name) for name in names):
            continue
        values = {name: new.get(name, node.get_parameter(name).value) for name in names}
        try:
            parameter_set.from_mapping(values)
        except ParameterError as error:
            return str(error)
    return ''
