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
Values as YAML text, numbers with all digits kept.

Examples
--------
>>> yaml_number(1e-05)
'1.0e-05'
>>> yaml_list([3, 0.25])
'[3.0, 0.25]'
>>> yaml_value('good: 3')
"'good: 3'"

"""

import math
from collections.abc import Iterable

import yaml

__all__ = ['yaml_list', 'yaml_number', 'yaml_value']


def yaml_number(value: float) -> str:
    """Return a number as text that YAML 1.1 parses as a float: with a point before an exponent."""
    mantissa, mark, exponent = repr(float(value)).partition('e')
    return (mantissa if '.' in mantissa else mantissa + '.0') + mark + exponent


def yaml_list(values: Iterable[float]) -> str:
    """Return numbers as a YAML list."""
    return '[' + ', '.join(map(yaml_number, values)) + ']'


def yaml_value(value: float | int | str | Iterable[float]) -> str:
    """Return a number, a text or a list of numbers as YAML."""
    if isinstance(value, str):
        # Quoted always: a text such as "good: 3" is not one for YAML.
        return yaml.safe_dump(
            value, default_style="'", width=math.inf, allow_unicode=True).strip()
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            return '.nan' if math.isnan(value) else ('.inf' if value > 0.0 else '-.inf')
        return yaml_number(value)
    return yaml_list(value)
