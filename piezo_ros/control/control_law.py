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

"""What every controller of the loop offers, and the base of one of your own."""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.controller_step import ControllerParameters

__all__ = ['ControlLaw', 'check_command']


class ControlLaw:
    """
    A controller without ROS: reference, feedforward and readings in, commands out.

    A subclass needs `answer` alone. It is made anew for each run.

    Parameters
    ----------
    parameters : ControllerParameters
        Gains and scheme that the node was given.
    sample_period_s : float
        Sample period, seconds.

    """

    def __init__(self, parameters: ControllerParameters, sample_period_s: float) -> None:
        self.parameters = parameters
        self.sample_period_s = sample_period_s

    def answer(
        self, index: int, reference_um: NDArray[np.float64], feedforward_um: NDArray[np.float64],
        displacement_um: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """
        Return the commands of consecutive samples.

        Parameters
        ----------
        index : int
            k of the first sample, from the first one of the run on.
        reference_um, feedforward_um, displacement_um : ndarray of float64, shape (N,)
            y_d, u_ff and y of the samples k … k+N-1, finite; N = 1 in a closed loop. What the
            scheme does not use may be zeros.

        Returns
        -------
        ndarray of float64, shape (N,)
            v[k] … v[k+N-1], micrometres, finite.

        """
        raise NotImplementedError

    def change(self, parameters: ControllerParameters, *, bumpless: bool) -> None:
        """
        Take over other gains or another scheme from the next sample on.

        Parameters
        ----------
        parameters : ControllerParameters
            Gains and scheme.
        bumpless : bool
            Whether the next command shall go on from the last one, as far as the scheme can.

        """
        self.parameters = parameters

    @property
    def recalled_samples(self) -> int:
        """How many of the last readings a scheme with feedback needs before its first sample."""
        return 0

    def recall(self, index: int, displacement_um: float) -> None:
        """Take note of a reading that came while the scheme had no use for it."""


def check_command(
    law: type[ControlLaw], index: int, command_um: NDArray[np.float64], count: int,
) -> None:
    """
    Check what a control law has returned.

    Raises
    ------
    ValueError
        If it is not one finite command for each sample.

    """
    name = f'{law.__name__}.answer'
    is_array = isinstance(command_um, np.ndarray)
    if not is_array or command_um.shape != (count,):
        returned = f'an array of shape {command_um.shape}' if is_array else repr(command_um)
        raise ValueError(
            f'{name} returned {returned} at sample {index}, it must be one of shape ({count},)')
    finite = np.isfinite(command_um)
    if not finite.all():
        first = int(np.argmin(finite))
        raise ValueError(
            f'{name} returned {command_um[first]} at sample {index + first}, it must be finite')
