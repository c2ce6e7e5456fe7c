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
The best known error of every cell of Table 4 on the calibrated rig, kept as data.

``best_known.csv`` comes from `piezo_ros.study.beyond.optimum`; its first line has the parameters of
the rig that it is of.
"""

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from piezo_ros.model import RigParameters

__all__ = ['BestKnown', 'best_known_csv', 'read_best_known']

BEST_KNOWN_FILE: Final = Path(__file__).with_name('best_known.csv')
_RIG: Final = '# rig: '
_COLUMNS: Final = ('amplitude_um', 'frequency_hz', 'nrmse_percent', 'band_hz')
# The search is without.
_SENSOR: Final = ('noise_rms_um', 'seed', 'adc_bits', 'adc_span_v', 'sensor_scale_um_per_v')


@dataclass(frozen=True)
class BestKnown:
    """
    The best voltage found for one scan.

    Attributes
    ----------
    amplitude_um, frequency_hz : float
        The triangle.
    nrmse_percent : float
        Its error without noise, percent of the peak-to-peak reference.
    band_hz : float
        Highest frequency of the voltage.

    """

    amplitude_um: float
    frequency_hz: float
    nrmse_percent: float
    band_hz: float


def best_known_csv(rig: RigParameters, found: Sequence[BestKnown]) -> str:
    """Return the content of the file."""
    lines = [
        _RIG + json.dumps(_without_sensor(rig.to_mapping())), ','.join(_COLUMNS), *(
            f'{one.amplitude_um:g},{one.frequency_hz:g},{one.nrmse_percent:.5f},{one.band_hz:g}'
            for one in found)]
    return '\n'.join(lines) + '\n'


def read_best_known(
    rig: RigParameters, path: Path = BEST_KNOWN_FILE,
) -> dict[tuple[float, float], float]:
    """
    Return the best known error of each (amplitude in um, frequency in Hz), percent.

    Parameters
    ----------
    rig : RigParameters
        The rig that is asked about.
    path : Path, optional
        Another file.

    Returns
    -------
    dict
        Empty where the file is of another rig.

    """
    with path.open(encoding='utf-8', newline='') as file:
        known: dict[str, Any] = json.loads(file.readline().removeprefix(_RIG))
        here = rig.to_mapping()
        # What the rig has learned to do since then must be off.
        known = {**_without_sensor(RigParameters().to_mapping()), **known}
        if any(here.get(name) != value for name, value in known.items()):
            return {}
        return {
            (float(row['amplitude_um']), float(row['frequency_hz'])): float(row['nrmse_percent'])
            for row in _rows(file)}


def _rows(file: Iterable[str]) -> Iterable[dict[str, str]]:
    return csv.DictReader(file)


def _without_sensor(parameters: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in parameters.items() if name not in _SENSOR}
