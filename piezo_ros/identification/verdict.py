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
How far an identified model may be trusted, in one line.

Examples
--------
>>> print(Verdict.good())
good
>>> print(Verdict.usable_up_to('640 Hz', 'beyond it the model misses the points by 7 %'))
usable up to 640 Hz: beyond it the model misses the points by 7 %
>>> print(Verdict.poor('χ² is 3070', '3 of 40 points are explained'))
do not trust, because χ² is 3070; 3 of 40 points are explained

"""

from dataclasses import dataclass
from typing import Final

__all__ = ['Verdict']

_GOOD: Final = 'good'
_USABLE: Final = 'usable up to'
_POOR: Final = 'do not trust'


@dataclass(frozen=True)
class Verdict:
    """
    The judgement on a model, by data that its fit has not seen.

    Attributes
    ----------
    word : str
        ``'good'``, ``'usable up to'`` or ``'do not trust'``.
    limit : str
        Up to where it is usable, with the unit; '' otherwise.
    reasons : tuple of str
        Why, each a clause without a full stop.

    """

    word: str
    limit: str = ''
    reasons: tuple[str, ...] = ()

    @classmethod
    def good(cls, *reasons: str) -> 'Verdict':
        """Return that the model explains the data within their noise, or as well as is needed."""
        return cls(_GOOD, '', reasons)

    @classmethod
    def usable_up_to(cls, limit: str, *reasons: str) -> 'Verdict':
        """Return that the model explains the data as far as a limit, for instance ``'640 Hz'``."""
        return cls(_USABLE, limit, reasons)

    @classmethod
    def poor(cls, *reasons: str) -> 'Verdict':
        """Return that the model does not explain the data."""
        return cls(_POOR, '', reasons)

    @property
    def is_poor(self) -> bool:
        """Whether the model is not to be trusted at all."""
        return self.word == _POOR

    def __str__(self) -> str:
        if self.is_poor:
            return f'{self.word}, because {"; ".join(self.reasons)}'
        head = f'{self.word} {self.limit}'.rstrip()
        return f'{head}: {"; ".join(self.reasons)}' if self.reasons else head
