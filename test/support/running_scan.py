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

"""A planned scan with a model that is a bit wrong, and a run of it that takes other tables."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.closed_loop import ClosedLoopRun
from piezo_ros.control.pi_controller import PiController
from piezo_ros.control.trajectory_blocks import ChangingTable
from piezo_ros.experiment.planned_scan import (
    ScanRequest,
    limits_of,
    planned_scan,
    write_planned_scan,
)
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.model.noise import unit_noise
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.parameters.parameter_file import read_parameter_set

__all__ = ['LAW', 'PERIOD_S', 'RIG', 'known_scan', 'played', 'run_with', 'trajectory_of']

PERIOD_S = 1e-5
RIG = read_parameter_set(
    Path(__file__).parents[2] / 'config' / 'rig.yaml', 'plant', RigParameters)
# What `piezo tune --max-sensitivity 1.6` gives on the published model.
LAW = ControllerParameters(
    proportional_gain=0.5616, integral_gain_per_s=3461.8, reference_delay_samples=1,
    command_minimum_um=-8.0, command_maximum_um=8.0)


@lru_cache(maxsize=4)
def known_scan(amplitude_um, frequency_hz, *, wrong=True):
    """Return request and plan of a triangle, with a model that errs by a few percent or not."""
    dynamics = RIG.true_dynamics
    if wrong:
        dynamics = dynamics.replaced(
            natural_frequency_1_rad_per_s=0.98 * dynamics.natural_frequency_1_rad_per_s,
            gain_k_rad3_per_s3=0.97 * dynamics.gain_k_rad3_per_s3)
    request = ScanRequest(
        'triangle', amplitude_um, frequency_hz, PERIOD_S, dynamics,
        HysteresisParameters.from_mapping(
            {name: getattr(RIG, name) for name in HysteresisParameters.names()}),
        limits_of(RIG))
    return request, planned_scan(request)


def trajectory_of(directory, amplitude_um=1.0, frequency_hz=500.0, *, periods):
    """Write a scan; return its file and the trajectory that plays it."""
    path = directory / 'scan.yaml'
    write_planned_scan(path, *known_scan(amplitude_um, frequency_hz))
    return path, read_parameter_set(path, 'trajectory', TrajectoryParameters).replaced(
        periods=periods)


def played(table, samples):
    """Return reference and command of the first samples of a table."""
    places = [table.place(k) for k in range(samples)]
    return table.reference_um[places], table.command_um[places]


def run_with(trajectory, law, after_block, *, block=100, rig=RIG):
    """Run the loop block by block; after each, a function may add tables; return all streams."""
    from piezo_ros.control.loop_kernels import closed_loop
    samples = trajectory.samples
    blocks = ChangingTable(trajectory, compiled=True)
    element, stage = PiController(law, PERIOD_S), Rig(rig, PERIOD_S)
    inverse = InverseHysteresis(known_scan(1.0, 500.0)[0].hysteresis)
    run = ClosedLoopRun(*(np.empty(samples + (k == 4)) for k in range(5)))
    run.displacement_um[0] = stage.measure()
    noise = unit_noise(rig.seed, 0, samples + 1)
    element.change(law, bumpless=False)
    for start in range(0, samples, block):
        stop = min(start + block, samples)
        run.reference_um[start:stop], run.feedforward_um[start:stop] = blocks(start, stop - start)
        closed_loop(element.memory, inverse.memory, stage.memory, noise, run, start, stop)
        after_block(blocks, run, start, stop)
    return run
