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

"""Rows and texts that several sections of the study's page need."""

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

from piezo_ros.report.page.content import Cell, Heading
from piezo_ros.study.results import StaticLoop

__all__ = ['PERCENT', 'Rows', 'known', 'nonlinearity_text']

Rows: TypeAlias = Sequence[Heading | Sequence[str | int | float | Cell | None]]
PERCENT: Final = 100.0


def known(value: float) -> float | None:
    """Return a value, None where it is not known."""
    return value if math.isfinite(value) else None


def nonlinearity_text(loop: StaticLoop) -> str:
    """Return the nonlinearity of a loop, input and output."""
    return (
        f'{PERCENT * loop.nonlinearity.input:.2f} / {PERCENT * loop.nonlinearity.output:.2f} %')
