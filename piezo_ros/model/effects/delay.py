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

"""A delay of whole samples, as a ring: its first number is the place of the oldest sample."""

from piezo_ros.model.step import Vector, step

__all__ = ['delay_step']


@step
def delay_step(delayed_v: Vector, samples: int, voltage_v: float) -> float:
    """Return the voltage of so many samples before; `delayed_v` has one number more than these."""
    if samples == 0:
        return voltage_v
    place = 1 + int(delayed_v[0])
    oldest_v: float = delayed_v[place]
    delayed_v[place] = voltage_v
    delayed_v[0] = float(place % samples)
    return oldest_v
