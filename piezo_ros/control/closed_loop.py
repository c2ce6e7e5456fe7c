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
The loop of trajectory, controller, compensator and rig offline: the same steps as in the nodes.

In the same order, too, beginning with the reading y[0] of the rig at rest::

    v[k]   = controller(y_d[k], u_ff[k], y[k])
    u[k]   = inverse(v[k])
    y[k+1] = rig(u[k])
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.changes import Change, segments
from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.control.trajectory_step import TrajectoryParameters
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

__all__ = ['BareRun', 'ClosedLoopRun', 'run_loop', 'simulate', 'simulate_bare', 'target_of']


class ClosedLoopRun(NamedTuple):
    """
    Every stream of a run, as deviations from the operating point.

    Attributes
    ----------
    reference_um, feedforward_um, command_um : ndarray, shape (N,)
        Desired displacement y_d, feedforward u_ff and linearised command v, micrometres.
    voltage_v : ndarray, shape (N,)
        Amplifier input u, volts.
    displacement_um : ndarray, shape (N + 1,)
        Readings y, micrometres; y[k] is taken before u[k] acts.

    """

    reference_um: NDArray[np.float64]
    feedforward_um: NDArray[np.float64]
    command_um: NDArray[np.float64]
    voltage_v: NDArray[np.float64]
    displacement_um: NDArray[np.float64]


class BareRun(NamedTuple):
    """
    The streams of a run without controller and compensator.

    Attributes
    ----------
    voltage_v : ndarray, shape (N,)
        Amplifier input, volts, from the operating point.
    displacement_um : ndarray, shape (N + 1,)
        Readings, micrometres, from the operating point; y[k] is taken before u[k] acts.

    """

    voltage_v: NDArray[np.float64]
    displacement_um: NDArray[np.float64]


def simulate_bare(plant: RigParameters, trajectory: TrajectoryParameters) -> BareRun:
    """
    Drive the bare actuator with a voltage offline; bit for bit what the live graph gives.

    Parameters
    ----------
    plant : RigParameters
        The rig.
    trajectory : TrajectoryParameters
        The voltage, its ``output`` being that.

    Returns
    -------
    BareRun
        Every stream of the run.

    Raises
    ------
    ValueError
        If the output of the trajectory is a displacement.

    """
    if trajectory.output != 'voltage':
        raise ValueError(f'output is {trajectory.output!r}, the bare actuator needs voltage')
    voltage_v, _ = trajectory_blocks(trajectory, compiled=True)(0, trajectory.samples)
    rig = Rig(plant, trajectory.sample_period_s)
    first_um = rig.measure()
    return BareRun(np.array(voltage_v), np.concatenate([[first_um], rig.run(voltage_v)]))


def simulate(
    plant: RigParameters,
    compensator: HysteresisParameters,
    controller: ControllerParameters,
    trajectory: TrajectoryParameters,
    changes: Sequence[Change] = (),
) -> ClosedLoopRun:
    """
    Run the whole loop offline; bit for bit what the live graph gives.

    Parameters
    ----------
    plant : RigParameters
        The rig.
    compensator : HysteresisParameters
        The hysteresis that the compensator inverts; of `CompensatorParameters` the creep too.
    controller : ControllerParameters
        Gains and scheme.
    trajectory : TrajectoryParameters
        The desired trajectory; its length is that of the run.
    changes : sequence of Change, optional
        Changes of gains and scheme during the run.

    Returns
    -------
    ClosedLoopRun
        Every stream of the run.

    Examples
    --------
    Four periods of a 1 um, 300 Hz triangle at 100 kHz, feedforward and feedback:

    >>> run = simulate(
    ...     RigParameters(), HysteresisParameters(), ControllerParameters(),
    ...     TrajectoryParameters(periods=4.0))
    >>> run.reference_um.size, run.displacement_um.size
    (1333, 1334)
    >>> error_um = run.reference_um - run.displacement_um[:-1]
    >>> bool(abs(error_um[-333:]).max() < 0.1)
    True

    """
    return run_loop(
        plant, compensator, controller, trajectory.sample_period_s, *target_of(trajectory),
        changes)


def target_of(
    trajectory: TrajectoryParameters,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return reference and feedforward of a whole run, micrometres, shape (N,) each."""
    reference_um, feedforward_um = trajectory_blocks(trajectory, compiled=True)(
        0, trajectory.samples)
    return np.asarray(reference_um), np.asarray(feedforward_um)


def run_loop(
    plant: RigParameters,
    compensator: HysteresisParameters,
    law: ControllerParameters,
    sample_period_s: float,
    reference_um: NDArray[np.float64],
    feedforward_um: NDArray[np.float64],
    changes: Sequence[Change] = (),
) -> ClosedLoopRun:
    """
    Close the loop around a given reference and feedforward; bit for bit what the live graph gives.

    Parameters
    ----------
    plant : RigParameters
        The rig, at rest and never driven.
    compensator : HysteresisParameters
        The hysteresis that the compensator inverts; of `CompensatorParameters` the creep too.
    law : ControllerParameters
        Gains and scheme.
    sample_period_s : float
        Sample period, seconds.
    reference_um, feedforward_um : ndarray of float64, shape (N,)
        What the trajectory sends.
    changes : sequence of Change, optional
        Changes of gains and scheme during the run.

    Returns
    -------
    ClosedLoopRun
        Every stream of the run.

    """
    from piezo_ros.control.loop_kernels import closed_loop, full_closed_loop
    samples = reference_um.size
    rig = Rig(plant, sample_period_s)
    controller = PiController(law, sample_period_s)
    inverse = InverseHysteresis(compensator, sample_period_s)
    run = ClosedLoopRun(
        np.array(reference_um), np.array(feedforward_um), np.empty(samples), np.empty(samples),
        np.empty(samples + 1))
    run.displacement_um[0] = rig.measure()
    noise = rig.noise(0, samples + 1)
    is_full = rig.constants.creep is not None or inverse.inverts_creep
    kernel = full_closed_loop if is_full else closed_loop
    for start, stop, piece in segments(law, changes, samples):
        if piece is not controller.parameters:
            controller.change(piece, bumpless=start > 0)
        kernel(controller.memory, inverse.memory, rig.memory, noise, run, start, stop)
    return run
