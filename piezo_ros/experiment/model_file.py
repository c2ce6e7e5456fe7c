"""Models that identification and tuning wrote, read back for the next step."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from piezo_ros.experiment.errors import PlanError
from piezo_ros.experiment.node_parameters import check_node_parameters
from piezo_ros.experiment.parameter_file import read_parameter_file, read_yaml
from piezo_ros.model import ParameterError, ParameterSet

if TYPE_CHECKING:
    import control

__all__ = ['BOUND_KIND', 'read_bound', 'read_node_model']

BOUND_KIND = 'uncertainty_bound'
FORMAT_VERSION = 1
_Set = TypeVar('_Set', bound=ParameterSet)


def read_node_model(
    path: Path, node: str, parameter_set: type[_Set], assumed: Mapping[str, Any] | None = None,
) -> _Set:
    """
    Return a parameter set out of a ROS parameter file.

    Parameters
    ----------
    path : Path
        The file.
    node : str
        The node whose section holds it.
    parameter_set : type of ParameterSet
        Which of the node's parameters.
    assumed : mapping of str to value, optional
        What holds where the file does not say otherwise; then come the node's own defaults.

    Raises
    ------
    PlanError
        If the file says nothing of the node, or something that the node refuses.

    """
    sections = read_parameter_file(path, [node])
    if node not in sections:
        raise PlanError(f'{path} has no section for {node}')
    try:
        values = check_node_parameters(node, {**(assumed or {}), **sections[node]})
        return parameter_set.among(values)
    except ParameterError as error:
        raise PlanError(f'{path}: {error}') from None


def read_bound(path: Path) -> 'control.TransferFunction':
    """
    Return W(s) out of a file that ``piezo identify uncertainty`` wrote.

    Raises
    ------
    PlanError
        If the file is of another kind or of an unknown version.

    """
    import control
    content = read_yaml(path)
    if not isinstance(content, Mapping) or content.get('kind') != BOUND_KIND:
        raise PlanError(f'{path} is no {BOUND_KIND}')
    if content.get('format_version') != FORMAT_VERSION:
        raise PlanError(
            f'{path}: format_version is {content.get("format_version")!r}, only {FORMAT_VERSION} '
            'is known')
    try:
        return control.tf(content['numerator'], content['denominator'])
    except (KeyError, TypeError, ValueError) as error:
        raise PlanError(f'{path}: {error}') from None
