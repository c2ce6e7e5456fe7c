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
Time that the identification of hysteresis and dynamics and the tuning of PI gains take.

The fit of a response stands beside those of scikit-rf and scipy, on the same points.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final

from benchmarks.measurement import Measurement, Ratio, lower, seconds
from benchmarks.response_peers import PEERS, STAGES, made_points, missing_peer, score
from piezo_ros.control import TrajectoryParameters, simulate_bare
from piezo_ros.control.waveform import excitation_of
from piezo_ros.identification import (
    FrequencyResponse,
    fit_dynamics,
    fit_hysteresis,
    frequency_response,
    run_excitation_offline,
    tune_pi,
)
from piezo_ros.model import LinearDynamics, MaxwellResistiveCapacitor, RigParameters

__all__ = ['FITS', 'FIT_RATIOS']

_FREQUENCIES_HZ: Final = (
    20.0, 40.0, 80.0, 150.0, 250.0, 400.0, 600.0, 800.0, 1000.0, 1300.0, 1600.0, 2000.0)
_PEER_ORDERS: Final = '6/8'  # the highest of `response_peers`


@cache
def _slow_triangle() -> Any:
    return simulate_bare(RigParameters(), TrajectoryParameters(
        output='voltage', waveform='decreasing_triangle', amplitude_v=3.0, frequency_hz=1.0,
        periods=5.0, harmonics=0, sample_period_s=1e-4))


@cache
def _response() -> FrequencyResponse:
    trajectory = TrajectoryParameters(
        waveform='stepped_sine', amplitude_um=0.1, frequencies_hz=_FREQUENCIES_HZ, harmonics=0)
    excitation = excitation_of(trajectory)
    _, displacement_um = run_excitation_offline(
        RigParameters(), MaxwellResistiveCapacitor(), excitation.command,
        trajectory.sample_period_s)
    return frequency_response(
        excitation.command, displacement_um, trajectory.sample_period_s, excitation=excitation)


@cache
def _long_triangle() -> Any:
    return simulate_bare(RigParameters(), TrajectoryParameters(
        output='voltage', waveform='decreasing_triangle', amplitude_v=3.0, frequency_hz=0.1,
        periods=10.0, harmonics=0, sample_period_s=1e-4))


def _hysteresis_s(
    elements: int = 10, record: Callable[[], Any] = _slow_triangle,
) -> Callable[[], tuple[float]]:
    def measure() -> tuple[float]:
        run = record()
        return (seconds(lambda: fit_hysteresis(
            run.voltage_v, run.displacement_um[:-1], elements=elements)),)
    return measure


def _dynamics_s() -> tuple[float]:
    response = _response()
    return (seconds(lambda: fit_dynamics(response)),)


def _tuning_s() -> tuple[float]:
    return (seconds(lambda: tune_pi(LinearDynamics())),)


def _peer(name: str) -> tuple[float, float]:
    zeros, poles = (int(order) for order in _PEER_ORDERS.split('/'))
    found = score(PEERS[name], *made_points(STAGES[_PEER_ORDERS]), (zeros, poles))
    return 100.0 * found.error, found.seconds


FITS: Final = (
    Measurement('fits', (lower('fit_hysteresis', 's'),), _hysteresis_s()),
    Measurement('fits', (lower('fit_hysteresis_40_elements', 's'),), _hysteresis_s(40)),
    Measurement(
        'fits', (lower('fit_hysteresis_1m_samples', 's'),), _hysteresis_s(record=_long_triangle)),
    Measurement('fits', (lower('fit_dynamics', 's'),), _dynamics_s),
    Measurement('fits', (lower('tune_pi', 's'),), _tuning_s),
    *(Measurement(
        'peers', (lower(f'error_of_{peer}', '%'), lower(f'fit_by_{peer}', 's')),
        partial(_peer, peer), partial(missing_peer, peer))
      for peer in PEERS),
)
FIT_RATIOS: Final = (
    Ratio('fit_hysteresis_over_decomposition', 'fit_hysteresis', 'decomposition',
          higher_is_better=False),
    Ratio('fit_hysteresis_40_over_10_elements', 'fit_hysteresis_40_elements', 'fit_hysteresis',
          higher_is_better=False),
    Ratio('fit_dynamics_over_decomposition', 'fit_dynamics', 'decomposition',
          higher_is_better=False),
    *(Ratio(f'error_over_that_of_{peer}', 'error_of_piezo_ros', f'error_of_{peer}',
            higher_is_better=False)
      for peer in PEERS if peer != 'piezo_ros'),
    Ratio('tune_pi_over_decomposition', 'tune_pi', 'decomposition', higher_is_better=False),
)
