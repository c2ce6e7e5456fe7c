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

"""One run on hardware: rest, demagnetisation, opening reading, and what plays the voltages."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.nodes.hardware_parts.clocked_run import ClockedRun
from piezo_ros.nodes.hardware_parts.on_demand_run import OnDemandRun
from piezo_ros.nodes.hardware_parts.reading_check import checked_readings
from piezo_ros.nodes.hardware_parts.sensor_watch import SensorWatch
from piezo_ros.nodes.hardware_parts.stage_output import StageOutput
from piezo_ros.parameters.hardware_parameters import HardwareParameters

__all__ = ['HardwareRun']


class HardwareRun:
    """
    Leads an output through a run, step by step, so that it can be stopped between two of them.

    Parameters
    ----------
    output : StageOutput
        The output, its device open.
    hardware : HardwareParameters
        How to drive it.
    sample_period_s : float
        Sample period, seconds.
    send_opening : callable
        Is given the reading at rest, before the first voltage.
    opens_itself : bool
        Whether it opens once it is prepared; where not, `open` is called as the run begins.

    Attributes
    ----------
    is_prepared : bool
        Whether the stage is ready for the first voltage.
    elapsed_s : float
        Wall-clock time that the run took from its start on the device, 0 before its end.

    """

    def __init__(
        self, output: StageOutput, hardware: HardwareParameters, sample_period_s: float,
        send_opening: Callable[[float], None], *, opens_itself: bool,
    ) -> None:
        self.elapsed_s = 0.0
        self._output = output
        self._hardware = hardware
        self._period_s = sample_period_s
        self._send_opening = send_opening
        self._opens_itself = opens_itself
        self._played: ClockedRun | OnDemandRun | None = None
        self._preparation: Iterator[None] = self._prepare()
        self.is_prepared = False
        self._began_s: float | None = None
        self._sensor = SensorWatch(hardware.reach_v)

    def _prepare(self) -> Iterator[None]:
        self._output.come_to_rest()
        yield
        if self._hardware.demagnetise:
            yield from self._output.demagnetise(SensorWatch(self._hardware.reach_v))

    def prepare(self) -> bool:
        """Do one step on the way to the start of the run; return whether there was one left."""
        if self.is_prepared:
            return False
        self.is_prepared = next(self._preparation, self) is self
        if self.is_prepared and self._opens_itself:
            self.open()
        return True

    def open(self) -> None:
        """Send the reading before the first voltage."""
        opening_um = float(checked_readings([self._output.opened.reading()], 0, 1)[0])
        self._output.limits.begin(0.0)
        self._played = (
            OnDemandRun(self._output, self._period_s) if self._hardware.is_on_demand
            else ClockedRun(self._output, self._hardware, self._period_s, opening_um))
        self._send_opening(opening_um)

    def accept(self, voltage_v: NDArray[np.float64], *, is_last: bool) -> None:
        """Take the next voltages, if any, and note the end; raises as `ClockedRun.accept`."""
        assert self._played is not None  # before the first block the run was opened
        if voltage_v.size:
            self._played.accept(voltage_v)
            self._sensor.play(voltage_v)
        if is_last:
            self._played.end()

    def advance(self) -> NDArray[np.float64] | None:
        """
        Return what `ClockedRun.advance` returns; None before the run was opened.

        Raises
        ------
        DeviceError
            As there, and if the sensor does not follow the voltage.

        """
        played = self._played
        if played is None or played.is_over:
            return None
        now_s = time.perf_counter()
        readings_um = played.advance()
        if readings_um is not None:
            self._sensor.check(readings_um)
        if readings_um is not None and self._began_s is None:
            self._began_s = now_s
        if played.is_over and self._began_s is not None:
            self.elapsed_s = time.perf_counter() - self._began_s
        return readings_um

    @property
    def is_over(self) -> bool:
        """Whether everything has been played."""
        return self._played is not None and self._played.is_over

    @property
    def overruns(self) -> int:
        """Number of voltages that came too late for software timing."""
        return self._played.overruns if self._played else 0

    @property
    def why_waiting(self) -> str:
        """What keeps the voltages that have come from being played, '' where nothing does."""
        return self._played.why_waiting if self._played else ''

    def is_making_progress(self) -> bool:
        """Return whether something was played since this was asked last."""
        return self._played is not None and self._played.is_making_progress()

    def status_fields(self) -> dict[str, Any]:
        """Return how the run is played."""
        played = self._played
        if played is None:
            return {'played': '', 'opening_difference_um': None}
        return {
            'played': played.mode, 'opening_difference_um': played.opening_difference_um,
            **(played.jitter() if isinstance(played, OnDemandRun) else {})}
