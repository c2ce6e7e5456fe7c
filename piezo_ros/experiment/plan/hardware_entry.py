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

"""A run of a plan on hardware: its plant has a device. What it takes, what it refuses."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.experiment.plan.automatic import Known, known_rig
from piezo_ros.model import ParameterError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import (
    HARDWARE_PLANT,
    check_node_parameters,
    parameter_names,
)
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = [
    'check_hardware', 'complete_plant', 'ignored_of_rig', 'is_of_hardware', 'rig_is_known',
    'stand_in',
]

_STAND_IN_NODES: Final = ('compensator', 'trajectory')  # hysteresis and dynamics


def is_of_hardware(values: Mapping[str, Any]) -> bool:
    """Return whether parameters of a plant are those of a device."""
    return 'device' in values


def complete_plant(values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return all parameters of a plant with a device: those of the hardware plant, and of a rig.

    The rig is what the device simulated is made of, and the data sheet by which plans are checked.

    Parameters
    ----------
    values : mapping of str to value
        What the plan says of the plant.

    Raises
    ------
    ParameterError
        If neither has such a parameter, or one refuses the value.

    """
    of_hardware, of_rig = parameter_names(HARDWARE_PLANT), parameter_names('plant')
    for name in values:
        if name not in of_hardware and name not in of_rig:
            raise ParameterError(
                f'unknown parameter {name!r} of {HARDWARE_PLANT}; it has '
                f'{", ".join(sorted(of_hardware))}')
    own = {name: value for name, value in values.items() if name in of_hardware}
    hardware = check_node_parameters(HARDWARE_PLANT, own)
    if HardwareParameters.among(hardware).simulated_rig_file:
        raise ParameterError(
            f'simulated_rig_file is {hardware["simulated_rig_file"]!r}; that is for a node started '
            'by hand, in a plan the parameters of the rig stand in plant')
    if 'demagnetise' not in values and not HardwareParameters.among(hardware).is_real:
        hardware['demagnetise'] = False  # The stage is a new one for every run.
    rig = {name: value for name, value in values.items() if name in of_rig}
    # A simulated sensor has no sign.
    rig['sensor_scale_um_per_v'] = abs(hardware['sensor_scale_um_per_v'])
    return {**check_node_parameters('plant', rig), **hardware}


def ignored_of_rig(values: Mapping[str, Any]) -> list[str]:
    """Return the parameters of a simulated rig that a plan gives to a real device in vain."""
    if not is_of_hardware(values) or not HardwareParameters.among(complete_plant(values)).is_real:
        return []
    return sorted(set(values) - set(parameter_names(HARDWARE_PLANT)))


def check_hardware(where: str, run: PlannedRun) -> None:
    """
    Refuse what a device cannot do, before anything is started.

    Parameters
    ----------
    where : str
        What errors begin with.
    run : PlannedRun
        The run; one without a device is not looked at.

    Raises
    ------
    PlanError
        If it needs feedback and the clock of the device plays it, or a parameter does not fit.

    """
    hardware = run.hardware
    if hardware is None:
        return
    plant = run.parameters['plant']
    for refusal in (
        hardware.refusal_of_period(run.trajectory.sample_period_s),
        hardware.refusal_of_slew(plant['safe_slew_v_per_s']),
        hardware.refusal_of_amplitude(plant['initialise_amplitude_v']),
    ):
        if refusal:
            raise PlanError(f'{where}: plant: {refusal}')
    if run.bare or hardware.is_on_demand:
        return
    schemes = [run.controller.concrete_scheme, *(
        str(change.values['scheme']) for change in run.changes if 'scheme' in change.values)]
    for scheme in schemes:
        if ControllerParameters(scheme=scheme).uses_feedback:
            raise PlanError(
                f'{where}: scheme is {scheme}, which needs each reading before the next voltage, '
                f'and plant: device {hardware.device} has timing hardware, which plays voltages '
                'that are there already; allowed are the schemes ff and open_loop, or timing '
                'on_demand up to 1 kHz')


def rig_is_known(run: PlannedRun, known: Known) -> bool:
    """Return whether known models can stand in for the stage of a run."""
    hardware = run.hardware
    return hardware is None or not hardware.is_real or all(
        known.sections.get(node) for node in _STAND_IN_NODES)


def stand_in(run: PlannedRun, known: Known) -> PlannedRun:
    """
    Return a run with the simulated rig in place of its device.

    Parameters
    ----------
    run : PlannedRun
        The run; one without a device is returned as it is.
    known : Known
        What the plan tells of the rig: hysteresis and dynamics of a real stage.

    Raises
    ------
    PlanError
        If the plan does not tell these of a real stage.

    """
    hardware = run.hardware
    if hardware is None:
        return run
    names = parameter_names('plant')
    plant = {name: run.parameters['plant'][name] for name in names}
    if hardware.is_real:
        missing = [node for node in _STAND_IN_NODES if not known.sections.get(node)]
        if missing:
            raise PlanError(
                f'{run.name}: device {hardware.device} is a real stage; to simulate it, '
                f'known_rig_files must tell its model, and they have no section for '
                f'{", ".join(missing)}')
        try:
            rig = known_rig(known.sections, run.plant, run.compensator, run.trajectory)
        except ParameterError as error:
            raise PlanError(f'{run.name}: known_rig_files: {error}') from None
        plant.update(rig.to_mapping())
    return replace(run, parameters={**run.parameters, 'plant': plant})
