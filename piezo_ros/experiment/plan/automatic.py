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
Decides the scheme and the harmonics that a run leaves to ``auto``, by a prediction.

The prediction is made before anything starts, from identified hysteresis and dynamics and the data
sheet of the amplifier. It never reads the mismatches of the simulated rig.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.shapes.fourier_series import PERIODIC
from piezo_ros.experiment.plan.planned_run import play_planned
from piezo_ros.model import (
    CompensatorParameters,
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    RigParameters,
)
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.run_and_result import PlannedRun

if TYPE_CHECKING:  # the mathematics is imported only where a run asks for it
    from piezo_ros.identification import OperatingPoint
    from piezo_ros.identification.prediction.accuracy import ModelAccuracy
    from piezo_ros.identification.tuning.linear_plant import Bound

__all__ = [
    'AUTO',
    'KNOWN_NODES',
    'Known',
    'decide',
    'known_rig',
    'place_is_told',
    'predict',
    'take_out_automatic',
]

AUTO: Final = 'auto'
_PLACE: Final = (
    'hysteresis_place', 'rates_before_hysteresis', 'pairs_before_hysteresis')
KNOWN_NODES: Final = ('compensator', 'plant', 'trajectory')
# Parameters of a rig that are in a data sheet. The list is explicit: a new parameter of the rig is
# not known unless it is added here.
_DATA_SHEET: Final = (
    'slew_limit_v_per_s', 'average_slew_limit_v_per_s', 'average_slew_time_s',
    'operating_point_v', 'operating_point_um', 'travel_um',
    'voltage_minimum_v', 'voltage_maximum_v', 'dac_bits', 'dac_span_v', 'adc_bits', 'adc_span_v',
    'sensor_scale_um_per_v', 'noise_rms_um')


@dataclass(frozen=True)
class Known:
    """
    What a plan tells of the rig beside its nodes, for the runs that leave something to ``auto``.

    Attributes
    ----------
    sections : mapping of str to mapping
        Node to parameters, out of ``known_rig_files``.
    bound : control.TransferFunction or None
        W(s), out of ``uncertainty_bound_file``.
    accuracy : ModelAccuracy or None
        What the model files of the plan tell of their own errors.

    """

    sections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    bound: 'Bound | None' = None
    accuracy: 'ModelAccuracy | None' = None


def known_rig(
    sections: Mapping[str, Mapping[str, Any]],
    plant: RigParameters,
    compensator: HysteresisParameters,
    trajectory: DynamicsParameters,
) -> RigParameters:
    """
    Return the rig of a run as far as it is known before the run.

    Parameters
    ----------
    sections : mapping of str to mapping
        One of `KNOWN_NODES` to parameters that are better known than those of the run. Parameters
        other than data sheet, hysteresis, dynamics and the order of the rig are ignored.
    plant : RigParameters
        The plant of the run; only its data sheet is read.
    compensator : HysteresisParameters
        The hysteresis that the run inverts.
    trajectory : DynamicsParameters
        The dynamics that its feedforward inverts.

    Returns
    -------
    RigParameters
        A rig without mismatches. Its poles are before and behind the hysteresis as the dynamics
        say, unless the sections tell of ``order: lumped``.

    Raises
    ------
    ParameterError
        If the known parameters and those of the run are inconsistent.

    """
    values = {name: getattr(plant, name) for name in _DATA_SHEET}
    for parameter_set, own, node in (
        # A creep that is inverted is taken to be there.
        (CompensatorParameters if isinstance(compensator, CompensatorParameters)
         else HysteresisParameters, compensator, 'compensator'),
        (DynamicsParameters, trajectory, 'trajectory'),
    ):
        names = parameter_set.names()
        chosen = _chosen(sections, node, names)
        # A model of another structure takes the place of the whole of it.
        if not chosen or chosen.get('dynamics', 'liu') == getattr(own, 'dynamics', 'liu'):
            values.update({name: getattr(own, name) for name in names})
        values.update(chosen)
    values.update(_chosen(sections, 'plant', (*_DATA_SHEET, 'order')))
    return RigParameters.from_mapping({'order': 'physical', **values})


def place_is_told(*trajectories: Mapping[str, Any]) -> bool:
    """
    Return whether any dynamics say which of their poles are before the hysteresis.

    Parameters
    ----------
    *trajectories : mapping of str to value
        Parameters of trajectory nodes as they are given, without defaults.

    """
    return any(set(_PLACE) & values.keys() for values in trajectories)


def _chosen(
    sections: Mapping[str, Mapping[str, Any]], node: str, names: Collection[str],
) -> dict[str, Any]:
    return {name: value for name, value in sections.get(node, {}).items() if name in names}


def predict(
    known: RigParameters,
    compensator: HysteresisParameters,
    controller: ControllerParameters,
    trajectory: TrajectoryParameters,
    undecided: Collection[str],
    *,
    bound: 'Bound | None' = None,
    accuracy: 'ModelAccuracy | None' = None,
    score_periods: float = 4.0,
) -> 'OperatingPoint':
    """
    Return the predicted scheme and harmonics of a run in which one or both are undecided.

    Parameters
    ----------
    known : RigParameters
        The rig as far as it is known, see `known_rig`.
    compensator : HysteresisParameters
        The hysteresis that the run inverts.
    controller : ControllerParameters
        Gains; and the scheme, with feedforward, unless that is undecided.
    trajectory : TrajectoryParameters
        The scan; and the harmonics, unless they are undecided.
    undecided : collection of str
        The parameters to decide: ``'scheme'``, ``'harmonics'`` or both.
    bound : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), the uncertainty of the known dynamics.
    accuracy : ModelAccuracy, optional
        What identification tells of the errors of the models.
    score_periods : float, optional
        Periods at the end of the run that will be scored.

    Returns
    -------
    OperatingPoint
        The decision and its grounds; `chosen` has the scheme and the harmonics of the run.

    Raises
    ------
    ParameterError
        If the waveform is not periodic, or the scheme has no feedforward.
    ValueError
        If the run has fewer periods than are scored, or both gains are 0.

    """
    from piezo_ros.identification import (
        OperatingPoint,
        choose_harmonics,
        predict_operating_point,
    )
    if trajectory.waveform not in PERIODIC:
        raise ParameterError(
            f'waveform is {trajectory.waveform!r}; auto can be decided for '
            f'{", ".join(PERIODIC)}')
    if 'scheme' in undecided:
        return predict_operating_point(
            known, trajectory, controller, harmonics_open='harmonics' in undecided,
            compensator=compensator, uncertainty=bound, accuracy=accuracy,
            score_periods=score_periods)
    choice = choose_harmonics(
        known, trajectory, controller, compensator=compensator, uncertainty=bound,
        accuracy=accuracy, score_periods=score_periods)
    scheme = controller.scheme
    return OperatingPoint(
        trajectory.amplitude_um, trajectory.frequency_hz, {scheme: choice.chosen},
        {scheme: choice}, loop=None)


def take_out_automatic(values: Mapping[str, dict[str, Any]]) -> tuple[str, ...]:
    """
    Return which of scheme and harmonics are ``auto``, and put valid values in their place for now.

    Parameters
    ----------
    values : mapping of str to dict
        Node to its parameters; changed in place.

    """
    undecided = []
    for name, node, for_now in (('scheme', 'controller', 'ff'), ('harmonics', 'trajectory', 0)):
        if values[node].get(name) == AUTO:
            values[node][name] = for_now
            undecided.append(name)
    return tuple(undecided)


def decide(
    where: str, run: PlannedRun, undecided: tuple[str, ...], known: Known, score_periods: float,
    *, place_told: bool = True,
) -> PlannedRun:
    """
    Return a run with scheme and harmonics decided by a prediction.

    Parameters
    ----------
    where : str
        What errors begin with.
    run : PlannedRun
        The run, as it is without the decision.
    undecided : tuple of str
        What to decide, as `take_out_automatic` returns it.
    known : Known
        What is known of the rig.
    score_periods : float
        Periods at the end of the run that will be scored.
    place_told : bool, optional
        Whether the dynamics say which poles are before the hysteresis, see `place_is_told`.

    Raises
    ------
    PlanError
        If nothing can be predicted.

    """
    if run.bare:
        raise PlanError(
            f'{where}: {undecided[0]} is auto; with output voltage there is neither controller nor '
            'feedforward, nothing can be decided')
    if 'scheme' not in undecided and not run.controller.uses_feedforward:
        return run  # its 0 harmonics are as good as any
    try:
        rig = known_rig(known.sections, run.plant, run.compensator, run.trajectory)
        if not place_told:
            from piezo_ros.identification.prediction.placement import likely_place
            rig = likely_place(rig)
        prediction = predict(
            rig, run.compensator, run.controller, run.trajectory, undecided, bound=known.bound,
            accuracy=known.accuracy, score_periods=score_periods)
        played = None if 'harmonics' not in undecided else play_planned(
            run, rig, prediction, score_periods, bound=known.bound, accuracy=known.accuracy)
    except ValueError as error:
        raise PlanError(f'{where}: {" and ".join(undecided)} auto: {error}') from None
    if played is not None:
        return played
    parameters = {node: dict(values) for node, values in run.parameters.items()}
    parameters['controller']['scheme'] = prediction.chosen.scheme
    parameters['trajectory']['harmonics'] = prediction.chosen.harmonics
    return replace(run, parameters=parameters, prediction=prediction)
