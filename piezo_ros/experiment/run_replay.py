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
What a recorded run would have been with other gains, another compensator, another scheme.

The recorded reference and feedforward drive the loop again, through the nodes that the bag's
parameters describe; what is not replaced gives the recorded bits. A rig is known by its data sheet,
its hysteresis and its dynamics: what of these neither the bag nor the caller tells is named and
refused, since the defaults are those of one stage, that of the paper.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import BagError, Run
from piezo_ros.bag.recorded_node import recorded_node
from piezo_ros.control import ClosedLoopRun, ControllerParameters, TrajectoryParameters
from piezo_ros.control.changes import Change, parse_changes, segments, without
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.experiment.model_file import HYSTERESIS_NAMES, missing_of_model
from piezo_ros.model import (
    CompensatorParameters,
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    ParameterSet,
    RigParameters,
)

__all__ = ['ReplayResult', 'replay']

_GAINS: Final = ('proportional_gain', 'integral_gain_per_s')

_Set = TypeVar('_Set', bound=ParameterSet)
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReplayResult:
    """
    A run that was not, beside the one that was.

    Attributes
    ----------
    recorded : Run
        The bag's run.
    streams : ClosedLoopRun
        Every stream of the replay; displacement has one sample more than the others.
    controller : ControllerParameters
        Gains and scheme of the replay.
    compensator : CompensatorParameters
        The hysteresis that its compensator inverts.
    plant : RigParameters
        Its rig.
    overridden : tuple of str
        What was given instead of taken from the bag.
    assumed : mapping of str to tuple of str
        Node to its parameters that the bag lacks: their defaults were taken.
    origins : mapping of str to str
        ``'hysteresis'`` and ``'dynamics'`` of the rig to where they are from: ``'bag'``,
        ``'plant'`` or ``'model'``.
    same_samples : mapping of str to int
        Recorded stream to the number of samples, from the first on, that the same loop without
        anything overridden gives bit for bit; empty where the bag does not tell all nodes. Less
        than the whole stream, and the replay is of a rig that behaved otherwise.

    """

    recorded: Run
    streams: ClosedLoopRun
    controller: ControllerParameters
    compensator: CompensatorParameters
    plant: RigParameters
    overridden: tuple[str, ...]
    assumed: Mapping[str, tuple[str, ...]]
    same_samples: Mapping[str, int]
    origins: Mapping[str, str]

    @property
    def is_faithful(self) -> bool:
        """Whether the bag's own nodes give the recorded run bit for bit."""
        return bool(self.same_samples) and all(
            count >= min(self.recorded.whole(stream)[1].size, _of(self.streams, stream).size)
            for stream, count in self.same_samples.items())


def replay(
    run: Run,
    *,
    controller: ControllerParameters | Mapping[str, Any] | None = None,
    compensator: CompensatorParameters | Mapping[str, Any] | None = None,
    scheme: str | None = None,
    plant: RigParameters | Mapping[str, Any] | None = None,
    hysteresis: HysteresisParameters | None = None,
    dynamics: DynamicsParameters | None = None,
) -> ReplayResult:
    """
    Simulate a recorded run again, with some of its nodes replaced.

    Parameters
    ----------
    run : Run
        The recorded run, from its first sample on.
    controller : ControllerParameters or mapping, optional
        Other gains; those of the bag by default. A mapping replaces the parameters it names and
        leaves the others as recorded, as a file of tuned gains means it. What is given applies to
        the whole run: changes that the bag lists leave it alone.
    compensator : CompensatorParameters or mapping, optional
        Another hysteresis to invert.
    scheme : str, optional
        Another scheme, whatever the controller's own.
    plant : RigParameters or mapping, optional
        The rig; needed where the bag tells of none, as one of a real stage or of another recorder.
    hysteresis : HysteresisParameters, optional
        Identified hysteresis of the rig, taken where neither bag nor plant tells it.
    dynamics : DynamicsParameters, optional
        Identified dynamics of the rig, taken likewise.

    Returns
    -------
    ReplayResult
        The replayed streams, and whether the recorded ones come out when nothing is replaced.

    Raises
    ------
    BagError
        If the bag does not begin with the run, lacks the reference, tells nothing of a node that
        is not given or only a part of what describes it, or of several nodes with the same role.
    ParameterError
        If a parameter of the bag or the scheme is out of range.

    """
    reference_um = _from_the_start(run, 'reference')
    given: dict[str, object] = {
        'controller': controller, 'compensator': compensator, 'plant': plant}
    recorded = _Recorded(run)
    own_controller = recorded.node('controller', ControllerParameters)
    own_compensator = recorded.node('compensator', CompensatorParameters)
    own_plant = recorded.node('plant', RigParameters)
    law = recorded.required(
        'controller', _replaced(own_controller, controller, ControllerParameters))
    inverted = recorded.required(
        'compensator', _replaced(own_compensator, compensator, CompensatorParameters))
    recorded.refuse_defaults('compensator', compensator, CompensatorParameters, HYSTERESIS_NAMES)
    rig, origins = _rig(recorded, own_plant, plant, hysteresis, dynamics)
    if scheme is not None:
        law = law.replaced(scheme=scheme)
        given['scheme'] = law
    if law.uses_feedback:
        recorded.refuse_defaults('controller', controller, ControllerParameters, _GAINS)
    own_changes = recorded.changes()
    changes = without(own_changes, _given_of(controller, scheme))
    needed = any(
        piece.law.uses_feedforward for piece in segments(law, changes, reference_um.size))
    feedforward_um = _feedforward(run, recorded, reference_um.size, needed)
    samples = feedforward_um.size
    reference_um = reference_um[:samples]
    period_s = run.sample_period_s

    streams = run_loop(rig, inverted, law, period_s, reference_um, feedforward_um, changes)
    same: dict[str, int] = {}
    if own_controller and own_compensator and own_plant:
        own = streams
        if (law, changes, inverted, rig) != (
            own_controller, own_changes, own_compensator, own_plant,
        ):
            own = run_loop(
                own_plant, own_compensator, own_controller, period_s, reference_um, feedforward_um,
                own_changes)
        same = {
            stream: _same_samples(run.whole(stream)[1], _of(own, stream))
            for stream in run.streams}
    return ReplayResult(
        recorded=run, streams=streams, controller=law, compensator=inverted, plant=rig,
        overridden=tuple(name for name, value in given.items() if value is not None),
        assumed={
            node: names for node, names in recorded.assumed.items()
            if not isinstance(given[node], ParameterSet)},
        same_samples=same, origins=origins)


def _rig(
    recorded: '_Recorded', own: RigParameters | None,
    given: RigParameters | Mapping[str, Any] | None, hysteresis: HysteresisParameters | None,
    dynamics: DynamicsParameters | None,
) -> tuple[RigParameters, dict[str, str]]:
    """Return the rig, and where its hysteresis and its dynamics are from."""
    if isinstance(given, RigParameters):
        return given, dict.fromkeys(('hysteresis', 'dynamics'), 'plant')
    if given is None:
        recorded.required('plant', own)
    told = recorded.told('plant', RigParameters)
    values, origins = {**told, **(given or {})}, {}
    for part, parameter_set, model in (
        ('hysteresis', HysteresisParameters, hysteresis),
        ('dynamics', DynamicsParameters, dynamics),
    ):
        missing = missing_of_model(values, parameter_set)
        origins[part] = 'plant' if set(parameter_set.names()) & set(given or {}) else 'bag'
        if missing and model is None:
            raise BagError(
                f'{recorded.path}: the {part} of the rig is not known, neither the bag nor the '
                f'plant that is given tells {", ".join(missing)}; it must be given, as '
                'identification writes it')
        if missing and model is not None:
            values.update({name: getattr(model, name) for name in parameter_set.names()})
            origins[part] = 'model'
    return RigParameters.from_mapping(values), origins


class _Recorded:
    """The nodes as the bag's parameters describe them."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self.path = run.path
        self.assumed: dict[str, tuple[str, ...]] = {}

    def parameters(self, node: str) -> dict[str, Any] | None:
        """Return what the bag tells of a node in the namespace of the run."""
        return recorded_node(self._run, node)

    def told(self, node: str, kind: type[ParameterSet]) -> dict[str, Any]:
        """Return what the bag tells of a node, of the parameters of one set."""
        values = self.parameters(node) or {}
        return {name: values[name] for name in kind.names() if name in values}

    def node(self, node: str, kind: type[_Set]) -> _Set | None:
        """Return the parameters of a node, else defaults; None if the bag tells nothing of it."""
        values = self.parameters(node)
        if values is None:
            return None
        names = [field.name for field in fields(kind)]
        missing = tuple(name for name in names if name not in values)
        if len(missing) == len(names):
            return None
        if missing:
            self.assumed[node] = missing
        try:
            return kind.from_mapping({name: values[name] for name in names if name in values})
        except ParameterError as error:
            raise ParameterError(f'{self._run.path}: {node}: {error}') from None

    def refuse_defaults(
        self, node: str, given: ParameterSet | Mapping[str, Any] | None,
        kind: type[ParameterSet], needed: Collection[str],
    ) -> None:
        """Refuse a node of which parameters without a sensible default are told nowhere."""
        if isinstance(given, ParameterSet):
            return
        told = {**self.told(node, kind), **(given or {})}
        missing = [name for name in needed if name not in told]
        if missing:
            raise BagError(
                f'{self.path}: neither the bag nor the {node} that is given tells '
                f'{", ".join(missing)}; it must be given')

    def changes(self) -> tuple[Change, ...]:
        """Return the changes of gains and scheme during the run."""
        values = self.parameters('controller') or {}
        try:
            return parse_changes(str(values.get('changes', '')))
        except ParameterError as error:
            raise ParameterError(f'{self._run.path}: controller: {error}') from None

    def required(self, node: str, value: _Set | None) -> _Set:
        """Return the parameters of a node, which there must be."""
        if value is None:
            known = ', '.join(sorted(self._run.parameters)) or 'none'
            raise BagError(
                f'{self._run.path} tells nothing of the {node} in the namespace '
                f'{self._run.namespace} (nodes with parameters: {known}); it must be given')
        return value


def _given_of(
    controller: ControllerParameters | Mapping[str, Any] | None, scheme: str | None,
) -> set[str]:
    """Return the parameters of the controller that are given for the whole run."""
    names = {'scheme'} if scheme is not None else set()
    if isinstance(controller, ControllerParameters):
        names.update(controller.to_mapping())
    elif controller is not None:
        names.update(controller)
    return names


def _replaced(
    own: _Set | None, given: _Set | Mapping[str, Any] | None, kind: type[_Set],
) -> _Set | None:
    """Return the parameters of a node with what was given in place of its own."""
    if given is None:
        return own
    if isinstance(given, Mapping):
        return own.replaced(**given) if own is not None else kind.from_mapping(given)
    return given


def _from_the_start(run: Run, stream: str) -> _Floats:
    start, samples = run.whole(stream)
    if start != 0:
        raise BagError(
            f'{run.path} begins at sample {start} of the stream {stream!r}: the state of the rig '
            'before it is not known, only a run from sample 0 can be replayed')
    return samples


def _feedforward(run: Run, recorded: _Recorded, samples: int, needed: bool) -> _Floats:
    """Return the recorded feedforward, else the one the bag's trajectory would have sent."""
    if 'feedforward' in run.streams:
        return _from_the_start(run, 'feedforward')[:samples]
    trajectory = recorded.node('trajectory', TrajectoryParameters)
    if trajectory is not None:
        return np.array(trajectory_blocks(trajectory, compiled=True)(0, samples)[1])
    if needed:
        raise BagError(
            f'{run.path} has no stream feedforward, which the scheme needs, and tells nothing of '
            f'the trajectory in the namespace {run.namespace}')
    return np.zeros(samples)


def _of(streams: ClosedLoopRun, stream: str) -> _Floats:
    values: _Floats = next(
        getattr(streams, name) for name in streams._fields if name.rpartition('_')[0] == stream)
    return values


def _same_samples(recorded: _Floats, again: _Floats) -> int:
    """Return how many samples from the first on are the same bits."""
    count = min(recorded.size, again.size)
    differs = np.flatnonzero(
        recorded[:count].view(np.uint64) != np.ascontiguousarray(again[:count]).view(np.uint64))
    return int(differs[0]) if differs.size else count
