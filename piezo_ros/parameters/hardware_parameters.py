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

"""The parameters of the hardware plant: which device, its wiring, its stage and its limits."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Final

from piezo_ros.hardware.calibration import Calibration
from piezo_ros.hardware.chosen_device import own_values
from piezo_ros.hardware.gcs import GcsParameters
from piezo_ros.hardware.limits import DriveLimits
from piezo_ros.hardware.ni import NiParameters
from piezo_ros.hardware.opening import DEVICE_KINDS, device_parameters
from piezo_ros.model import ParameterError, ParameterSet
from piezo_ros.model.parameters import parameter

__all__ = [
    'DEVICES',
    'HARDWARE_TIMED',
    'ON_DEMAND',
    'SIMULATED',
    'HardwareParameters',
    'is_known_device',
]

SIMULATED: Final = 'simulated'
# The devices that the package brings; any other one is named as MODULE:CLASS.
DEVICES: Final = DEVICE_KINDS
HARDWARE_TIMED, ON_DEMAND = 'hardware', 'on_demand'
_SHORTEST_ON_DEMAND_S: Final = 1e-3
# Over all the rails: a process that is told to end has some 10 s.
_LONGEST_RAMP_S: Final = 4.0
_BLOCK_S: Final = 0.05  # of readings that are fetched at once, and so the longest wait for a stop


def _of(parameter_set: type[ParameterSet], name: str) -> Any:
    """Return a field that is declared as that of a device."""
    field = parameter_set.__dataclass_fields__[name]
    return dataclasses.field(default=field.default, metadata=field.metadata)


def is_known_device(device: str) -> bool:
    """Return whether a text may name a device: one of `DEVICES`, or MODULE:CLASS."""
    module, colon, name = device.partition(':')
    return device in DEVICES or bool(
        colon and name.isidentifier() and all(map(str.isidentifier, module.split('.'))))


@dataclass(frozen=True, kw_only=True)
class HardwareParameters(Calibration, DriveLimits):
    """A stage behind a device with converters of its own, and how it is driven."""

    device: str = parameter(
        SIMULATED, '', f'{", ".join(DEVICES)}, or MODULE:CLASS for one of your own')
    address: str = parameter(
        '', '', 'where the device is: for ni the gRPC device server HOST:PORT, empty for the local '
        'driver; for gcs HOST:PORT or a serial port; for one of your own what it makes of it')
    output_channel: str = _of(NiParameters, 'output_channel')
    input_channel: str = _of(NiParameters, 'input_channel')
    held_channel: str = _of(NiParameters, 'held_channel')
    terminals: str = _of(NiParameters, 'terminals')
    input_range_v: float = _of(NiParameters, 'input_range_v')
    timeout_s: float = _of(NiParameters, 'timeout_s')
    axis: str = _of(GcsParameters, 'axis')
    output_signal: int = _of(GcsParameters, 'output_signal')
    generator: int = _of(GcsParameters, 'generator')
    wave_table: int = _of(GcsParameters, 'wave_table')
    baud_rate: int = _of(GcsParameters, 'baud_rate')
    target_scale_um_per_v: float = _of(GcsParameters, 'target_scale_um_per_v')
    simulated_rig_file: str = parameter(
        '', '', 'for the device simulated: parameter file of the plant node that it stands for')
    timing: str = parameter(
        HARDWARE_TIMED, '', 'hardware: the clock of the device plays the run, which must do '
        'without feedback; on_demand: software sets each sample, at most 1 kHz, feedback allowed',
        choices=(HARDWARE_TIMED, ON_DEMAND))
    prefill_samples: int = parameter(
        0, 'samples', 'voltages that wait on the device before it starts; 0: the whole run, which '
        'then cannot run dry', minimum=0, maximum=10**9)
    buffer_samples: int = parameter(
        4_000_000, 'samples', 'voltages, and readings, that wait in memory (8 bytes each); a '
        'longer run is streamed', minimum=1000, maximum=10**8)
    read_samples: int = parameter(
        0, 'samples', 'readings that are fetched at once; 0: what comes in 50 ms',
        minimum=0, maximum=10**7)
    demagnetise: bool = parameter(
        True, '', 'drive the decaying triangle of ~/initialise before each run')

    def check_together(self) -> None:
        """Refuse an unknown device beside what calibration and limits refuse."""
        Calibration.check_together(self)
        DriveLimits.check_together(self)
        chosen = device_parameters(self.device) if self.device in DEVICE_KINDS else None
        if chosen:
            # As the device itself will refuse it, but before anything is started.
            chosen.from_mapping(own_values(self.device, self.to_mapping()))
        if not is_known_device(self.device):
            raise ParameterError(
                f'device is {self.device!r}, allowed are {", ".join(DEVICES)} and MODULE:CLASS')

    @property
    def is_on_demand(self) -> bool:
        """Whether software sets each sample."""
        return self.timing == ON_DEMAND

    @property
    def is_real(self) -> bool:
        """Whether a voltage goes out into the world."""
        return self.device != SIMULATED

    @property
    def reach_v(self) -> float:
        """Distance of the nearer rail from the operating point."""
        return min(
            self.operating_point_v - self.voltage_minimum_v,
            self.voltage_maximum_v - self.operating_point_v)

    def samples_at_once(self, sample_period_s: float) -> int:
        """Return how many readings are fetched at once."""
        return self.read_samples or max(1, math.floor(_BLOCK_S / sample_period_s))

    def refusal_of_period(self, sample_period_s: float) -> str:
        """Return why a sample period is too short for software timing, '' where it is not."""
        if not self.is_on_demand or sample_period_s >= _SHORTEST_ON_DEMAND_S:
            return ''
        return (
            f'sample_period_s is {sample_period_s:g} s; timing on_demand needs '
            f'{_SHORTEST_ON_DEMAND_S:g} s or more (1 kHz), software is not faster for certain')

    def refusal_of_slew(self, safe_slew_v_per_s: float) -> str:
        """Return why the ramp to rest cannot have a slew, '' if it can."""
        span_v = self.voltage_maximum_v - self.voltage_minimum_v
        least, most = span_v / _LONGEST_RAMP_S, self.slew_limit_v_per_s or math.inf
        if least <= safe_slew_v_per_s <= most:
            return ''
        return (
            f'safe_slew_v_per_s is {safe_slew_v_per_s:g} V/s, allowed is {least:g} … {most:g} V/s: '
            f'the ramp over the rails, {span_v:g} V, may take {_LONGEST_RAMP_S:g} s, and '
            f'slew_limit_v_per_s is {self.slew_limit_v_per_s:g} V/s')

    def refusal_of_amplitude(self, initialise_amplitude_v: float) -> str:
        """Return why the decaying triangle cannot have an amplitude, '' if it can."""
        if initialise_amplitude_v <= self.reach_v:
            return ''
        return (
            f'initialise_amplitude_v is {initialise_amplitude_v:g} V, the nearer rail allows '
            f'0 … {self.reach_v:g} V')

    def lookahead_samples(self, run_samples: int, sample_period_s: float) -> int:
        """Return how far a run of some length must be sent ahead of its readings."""
        if self.is_on_demand:
            return 1
        prefill = self.prefill_samples or min(run_samples, self.buffer_samples)
        # The demand is renewed when half of it is used up, and then the next samples are made.
        return 2 * min(prefill, run_samples) + 4 * self.samples_at_once(sample_period_s) + 1
