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

"""A run, whether on live nodes or offline: what its nodes are told, and how it went."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.changes import Change, parse_changes
from piezo_ros.model import CompensatorParameters, ParameterSet, RigParameters
from piezo_ros.model.parameters import as_yaml
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import LOOP_NODES

__all__ = ['PlannedRun', 'Prediction', 'RunResult']


class Prediction(Protocol):
    """The predicted error by which scheme or harmonics of a run were decided."""

    @property
    def nrmse_percent(self) -> float:
        """Predicted tracking error."""

    @property
    def reason(self) -> str:
        """Why it was decided so, in words."""

    def record(self) -> dict[str, Any]:
        """Return the decision and its grounds for report.json."""


@dataclass(frozen=True)
class PlannedRun:
    """
    A run with the parameters of all of its nodes.

    Attributes
    ----------
    name : str
        Name of its directories, unique within the plan.
    parameters : mapping of str to mapping
        One of `LOOP_NODES` to all of its parameters; a plant with a device has those of the
        hardware plant beside those of a rig.
    prediction : Prediction or None
        What was decided for the run and why, where its scheme or harmonics were ``auto``.

    """

    name: str
    parameters: Mapping[str, Mapping[str, Any]]
    prediction: Prediction | None = None

    @property
    def bare(self) -> bool:
        """Whether the trajectory drives the amplifier itself."""
        return bool(self.parameters['trajectory']['output'] == 'voltage')

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes of the loop that take part."""
        return ('plant', 'trajectory') if self.bare else LOOP_NODES

    @cached_property
    def plant(self) -> RigParameters:
        """The rig."""
        return RigParameters.among(self.parameters['plant'])

    @cached_property
    def hardware(self) -> HardwareParameters | None:
        """The device that the run is on, None for the simulated rig."""
        plant = self.parameters['plant']
        return HardwareParameters.among(plant) if 'device' in plant else None

    @cached_property
    def compensator(self) -> CompensatorParameters:
        """The hysteresis, and the creep, that the compensator inverts."""
        return CompensatorParameters.among(self.parameters['compensator'])

    @cached_property
    def controller(self) -> ControllerParameters:
        """Gains and scheme."""
        return ControllerParameters.among(self.parameters['controller'])

    def with_model(self, node: str, model: ParameterSet, names: Iterable[str]) -> 'PlannedRun':
        """
        Return the run with another model of a node.

        Parameters
        ----------
        node : str
            One of `LOOP_NODES`.
        model : ParameterSet
            What the property of that name has in place of its own.
        names : iterable of str
            The parameters in which they differ.

        """
        own = {name: as_yaml(getattr(model, name)) for name in names}
        run = replace(self, parameters={
            **self.parameters, node: {**self.parameters[node], **own}})
        # The models are properties that are computed once: the others stay as they are.
        vars(run).update({
            name: vars(self)[name] for name in LOOP_NODES if name in vars(self)}, **{node: model})
        return run

    @property
    def changes(self) -> tuple[Change, ...]:
        """Changes of gains and scheme during the run."""
        return parse_changes(self.parameters['controller']['changes'])

    @cached_property
    def trajectory(self) -> TrajectoryParameters:
        """The desired trajectory."""
        return TrajectoryParameters.among(self.parameters['trajectory'])

    @property
    def description(self) -> str:
        """One line about the run."""
        trajectory = self.trajectory
        unit = 'V' if self.bare else 'um'
        about = f' about {trajectory.offset:g} {unit}' if trajectory.offset else ''
        if self.bare:
            frequencies_hz = (
                f'{min(trajectory.frequencies_hz):g} … {max(trajectory.frequencies_hz):g}'
                if trajectory.waveform == 'stepped_sine' else f'{trajectory.frequency_hz:g}')
            return (
                f'bare actuator: {trajectory.waveform} {trajectory.amplitude_v:g} V{about}, '
                f'{frequencies_hz} Hz, {trajectory.samples} samples')
        # What follows during the run counts as much as what it begins with.
        schemes = [self.controller.scheme, *(
            f'{change.values.get("scheme", "other gains")} from sample {change.at_sample} on'
            for change in self.changes), *(
            f'another file from sample {change.at_sample} on'
            for change in trajectory.table_changes)]
        return (
            f'{", ".join(schemes)}: {trajectory.waveform} {trajectory.amplitude_um:g} um{about}, '
            f'{trajectory.frequency_hz:g} Hz, m = {trajectory.harmonics}, '
            f'{trajectory.samples} samples')


@dataclass(frozen=True)
class RunResult:
    """
    How one run went.

    Attributes
    ----------
    wall_seconds : float
        Wall-clock time from the first sample to the last, without start-up.
    notes : tuple of str
        What a reader of the report should know.

    """

    wall_seconds: float
    notes: tuple[str, ...] = ()
