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

"""Rails, travel and operating point of a stage, which must fit each other."""

from typing import Any

from piezo_ros.model.parameters import ParameterError

__all__ = ['check_operating_point']


def check_operating_point(limits: Any) -> None:
    """
    Refuse rails the wrong way round, and an operating point outside the rails or the travel.

    Parameters
    ----------
    limits : RigParameters or DriveLimits
        Rails, travel and operating point.

    Raises
    ------
    ParameterError
        If one of them does not fit the others.

    """
    low_v, high_v = limits.voltage_minimum_v, limits.voltage_maximum_v
    if low_v >= high_v:
        raise ParameterError(
            f'voltage_minimum_v is {low_v:g} V and voltage_maximum_v {high_v:g} V, the minimum '
            'must be below the maximum')
    for value, name, low, high in (
        (limits.operating_point_v, 'operating_point_v', low_v, high_v),
        (limits.operating_point_um, 'operating_point_um', 0.0, limits.travel_um),
    ):
        if not low <= value <= high:
            raise ParameterError(f'{name} is {value}, allowed is {low} … {high}')
