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

"""Frequency responses of the bags for ``piezo identify dynamics`` and ``uncertainty``."""

import argparse
from pathlib import Path

from piezo_ros.bag import Run
from piezo_ros.control import TrajectoryParameters
from piezo_ros.experiment.recorded_response import recorded_response
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.model import HysteresisParameters
from piezo_ros.parameters.parameter_file import read_parameter_set

__all__ = ['add_response_arguments', 'responses']


def add_response_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe what the bags may not say: the trajectory, the hysteresis, the amplifier."""
    kind.add_argument(
        '--trajectory', type=Path, action='append', metavar='FILE',
        help='parameters of the trajectory that was played, where the bag does not say them: '
        'once for all bags or once for each, in their order')
    kind.add_argument(
        '--compensator', type=Path, metavar='FILE',
        help='take the command from the voltage by the hysteresis of this file: for runs of '
        'the bare actuator')
    kind.add_argument(
        '--slew-limit-v-per-s', type=float, metavar='S',
        help='of the amplifier, where the bag does not say it')


def responses(options: argparse.Namespace, runs: list[Run]) -> list[FrequencyResponse]:
    """Return the response of each bag; what was left out of it is printed."""
    played = options.trajectory or [None]
    if len(played) not in (1, len(runs)):
        raise ValueError(
            f'--trajectory is given {len(played)} times for {len(runs)} bags, allowed is once or '
            'once for each')
    hysteresis = None
    if options.compensator:
        hysteresis = read_parameter_set(options.compensator, 'compensator', HysteresisParameters)
    found = []
    for run, path in zip(runs, played * (len(runs) // len(played)), strict=True):
        trajectory = None if path is None else read_parameter_set(
            path, 'trajectory', TrajectoryParameters, {'sample_period_s': run.sample_period_s})
        response = recorded_response(
            run, slew_limit_v_per_s=options.slew_limit_v_per_s, trajectory=trajectory,
            hysteresis=hysteresis)
        for point in response.excluded:
            print(f'left out of {run.path.name}: {point.frequency_hz:g} Hz: {point.reason}')
        for loss in response.losses:
            print(f'lost of {run.path.name}: {loss}')
        found.append(response)
    return found
