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

"""A measured frequency response as CSV, with the points that were left out."""

import csv
import io

import numpy as np

from piezo_ros.identification.response.frequency_response import FrequencyResponse

__all__ = ['response_csv']

_COLUMNS = (
    'frequency_hz', 'magnitude', 'phase_deg', 'confidence_radius', 'coherence', 'distortion',
    'amplitude', 'offset', 'left_out')


def response_csv(response: FrequencyResponse) -> str:
    """
    Return a frequency response as CSV, all digits kept.

    Parameters
    ----------
    response : FrequencyResponse
        The points.

    Returns
    -------
    str
        One line per point, in order of frequency: magnitude, phase (degrees), radius of the circle
        that contains the true response in 95 % of cases, coherence (empty where there was one group
        of periods only), distortion, amplitude and offset; for a point left out the reason.

    """
    rows: list[tuple[float | str, ...]] = [
        (*(_number(value) for value in values), '') for values in zip(
            response.frequency_hz, np.abs(response.response),
            np.angle(response.response, deg=True), response.confidence_radius,
            response.coherence, response.distortion, response.amplitude, response.offset,
            strict=True)]
    rows += [
        (point.frequency_hz, '', '', '', '', '', point.amplitude, point.offset, point.reason)
        for point in response.excluded]
    rows.sort(key=_frequency)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(_COLUMNS)
    writer.writerows(rows)
    return text.getvalue()


def _frequency(row: tuple[float | str, ...]) -> float:
    return float(row[0])


def _number(value: float) -> float | str:
    return float(value) if np.isfinite(value) else ''
