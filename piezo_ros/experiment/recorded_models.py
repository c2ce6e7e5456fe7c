"""From a recorded bag to what an identification needs: parameters of the nodes, responses."""

import math
from typing import TypeVar

from piezo_ros.bag import BagError, Run
from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.waveform import excitation_of
from piezo_ros.identification import Amplifier, FrequencyResponse, frequency_response
from piezo_ros.model import ParameterSet, RigParameters

__all__ = ['recorded_parameters', 'recorded_response']

_Set = TypeVar('_Set', bound=ParameterSet)


def recorded_parameters(run: Run, node: str, parameter_set: type[_Set]) -> _Set:
    """
    Return the parameters that a node had in a run.

    Parameters
    ----------
    run : Run
        The run.
    node : str
        Node name without namespace.
    parameter_set : type of ParameterSet
        Which of its parameters.

    Raises
    ------
    BagError
        If the bag does not hold the parameters of the node.

    """
    for name, values in run.parameters.items():
        if name.rpartition('/')[2] == node:
            known = parameter_set().to_mapping()
            return parameter_set.from_mapping(
                {key: value for key, value in values.items() if key in known})
    raise BagError(f'{run.path} does not hold the parameters of {node}')


def recorded_response(
    run: Run, *, bare: bool = False, closed_loop: bool = False,
    slew_limit_v_per_s: float | None = None,
) -> FrequencyResponse:
    """
    Return the frequency response of the compensated (or the bare) actuator in a run.

    Parameters
    ----------
    run : Run
        A stepped sine or multisine; the parameters of its trajectory tell which.
    bare : bool, optional
        From voltage to displacement; from command to displacement by default.
    closed_loop : bool, optional
        From reference to displacement.
    slew_limit_v_per_s : float, optional
        Of the amplifier; what the plant of the bag says by default, or none.

    Returns
    -------
    FrequencyResponse
        Micrometres per micrometre (or per volt); points where the amplifier slews or saturates are
        left out and listed.

    Raises
    ------
    BagError
        If the bag lacks the parameters of the trajectory.
    ParameterError
        If the trajectory was no excitation.

    """
    excitation = excitation_of(recorded_parameters(run, 'trajectory', TrajectoryParameters))
    amplifier = Amplifier(slew_limit_v_per_s or math.inf)
    if any(name.rpartition('/')[2] == 'plant' for name in run.parameters):
        plant = recorded_parameters(run, 'plant', RigParameters)
        amplifier = Amplifier(
            slew_limit_v_per_s or plant.slew_limit_v_per_s or math.inf,
            plant.voltage_minimum_v - plant.operating_point_v,
            plant.voltage_maximum_v - plant.operating_point_v)
    if bare:
        input_ = run.voltage_v
    else:
        input_ = run.reference_um if closed_loop else run.command_um
    return frequency_response(
        input_, run.displacement_um, run.sample_period_s,
        excitation=excitation, voltage_v=run.voltage_v, amplifier=amplifier)
