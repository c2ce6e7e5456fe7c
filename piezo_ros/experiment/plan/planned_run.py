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
A run that is left to ``auto`` and plays a planned scan, where that is predicted to err least.

The motion is kept in the cache of the user, named after its content, for the nodes to read.
"""

import hashlib
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.control.tables.motion_table import MotionTable, write_motion_table
from piezo_ros.experiment.planned_scan import motion_of
from piezo_ros.model import RigParameters
from piezo_ros.parameters.run_and_result import PlannedRun
from piezo_ros.user_directories import cache_directory

if TYPE_CHECKING:  # the mathematics is imported only where a run asks for it
    from piezo_ros.identification import OperatingPoint
    from piezo_ros.identification.prediction.accuracy import ModelAccuracy
    from piezo_ros.identification.tuning.linear_plant import Bound

__all__ = ['play_planned']

_FOLDER: Final = Path('piezo_ros') / 'planned_scans'


def play_planned(
    run: PlannedRun, rig: RigParameters, prediction: 'OperatingPoint', score_periods: float, *,
    bound: 'Bound | None', accuracy: 'ModelAccuracy | None',
) -> PlannedRun | None:
    """
    Return the run with a planned scan, None where another scheme is predicted to err less.

    Parameters
    ----------
    run : PlannedRun
        The run, without the decision.
    rig : RigParameters
        The rig as far as it is known.
    prediction : OperatingPoint
        The other candidates.
    score_periods : float
        Periods at the end of the run that will be scored, for which it must have settled.
    bound : UncertaintyBound, control.TransferFunction or callable, optional
        W(s), the uncertainty of the known dynamics.
    accuracy : ModelAccuracy, optional
        What identification tells of the errors of the models.

    """
    from piezo_ros.identification.prediction.planned_choice import (
        PLANNED,
        plan_candidate,
        with_planned,
    )
    if 'ff' not in prediction.predictions:
        return None
    choice = plan_candidate(rig, run.trajectory, uncertainty=bound, accuracy=accuracy)
    point = with_planned(prediction, choice)
    if choice is None or point.scheme != PLANNED:
        return None
    motion = motion_of(choice.request, choice.plan, run.compensator)
    assert motion.command_um is not None
    assert motion.repeat_from is not None
    law, trajectory = run.controller, run.trajectory
    scored = math.ceil(score_periods / (trajectory.frequency_hz * trajectory.sample_period_s))
    if (motion.repeat_from + scored > trajectory.samples
            or motion.command_um.min() < law.command_minimum_um
            or motion.command_um.max() > law.command_maximum_um):
        return None
    parameters = {node: dict(values) for node, values in run.parameters.items()}
    parameters['controller']['scheme'] = 'ff'
    parameters['trajectory'] |= {
        'waveform': 'file', 'file': str(_kept(motion)), 'harmonics': 0, 'ramp_periods': 0.0,
        # The motion has both already.
        'offset_um': 0.0, 'turn_fraction': 0.0}
    return replace(run, parameters=parameters, prediction=point)


def _kept(motion: MotionTable) -> Path:
    """Return the file of a motion, written where it is not there."""
    digest = hashlib.sha256()
    for values in (motion.reference_um, motion.command_um):
        assert values is not None
        digest.update(values.tobytes())
    digest.update(f'{motion.sample_period_s!r} {motion.repeat_from}'.encode())
    folder = cache_directory() / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{digest.hexdigest()[:24]}.npz'
    if not path.exists():
        draft = path.with_name(f'{path.stem}.{os.getpid()}.npz')
        write_motion_table(draft, motion)
        draft.replace(path)
    return path
