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

"""Numbers as text that every reader of YAML takes for floating-point numbers, all digits kept."""

from collections.abc import Iterable

__all__ = ['yaml_list', 'yaml_number']


def yaml_number(value: float) -> str:
    """Return a float that YAML 1.1 reads as one: it wants a point before the exponent."""
    mantissa, mark, exponent = repr(float(value)).partition('e')
    return (mantissa if '.' in mantissa else mantissa + '.0') + mark + exponent


def yaml_list(values: Iterable[float]) -> str:
    """Return a list of such numbers."""
    return '[' + ', '.join(map(yaml_number, values)) + ']'
