"""Declares parameter sets as ROS parameters and reads them back, refusing what they refuse."""

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from piezo_ros.model.parameters import ParameterError, ParameterSet, constraint_of

__all__ = ['declare', 'read']

_Set = TypeVar('_Set', bound=ParameterSet)


def declare(node: Node, *sets: type[ParameterSet]) -> None:
    """
    Declare every parameter of some sets with description, range and unit.

    Parameters
    ----------
    node : Node
        Where to declare.
    *sets : type of ParameterSet
        The sets; a name that two of them share is declared once.

    """
    for parameter_set in sets:
        for field in dataclasses.fields(parameter_set):
            if not node.has_parameter(field.name):
                default = field.default
                node.declare_parameter(
                    field.name, list(default) if isinstance(default, tuple) else default,
                    _descriptor(field))
    node.add_on_set_parameters_callback(lambda changes: _check_changes(node, sets, changes))


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


def _descriptor(field: 'dataclasses.Field[Any]') -> ParameterDescriptor:
    constraint = constraint_of(field)
    text = constraint.description
    if constraint.unit:
        text += f' [{constraint.unit}]'
    descriptor = ParameterDescriptor(name=field.name, description=text)
    if constraint.choices:
        descriptor.additional_constraints = 'one of ' + ', '.join(constraint.choices)
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


def _check_changes(
    node: Node, sets: tuple[type[ParameterSet], ...], changes: list[Parameter[Any]],
) -> SetParametersResult:
    """Refuse a change that a set would refuse; all of one call or nothing."""
    new = {change.name: change.value for change in changes}
    for parameter_set in sets:
        names = [field.name for field in dataclasses.fields(parameter_set)]
        if not new.keys() & set(names) or not all(node.has_parameter(name) for name in names):
            continue
        values = {name: new.get(name, node.get_parameter(name).value) for name in names}
        try:
            parameter_set.from_mapping(values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)
