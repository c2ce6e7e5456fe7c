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
Types of the options of all commands: each names the value and what is allowed.

An error of a type begins with ``is``: `CommandParser` puts the option before it. Bounds are those
of the parameters of the nodes where an option stands for one, else far beyond what any stage needs:
what is beyond them is a slip, and would end in an overflow or without memory.
"""

import math
import re
from argparse import ArgumentTypeError
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = [
    'AMPLITUDE_UM', 'COUNT', 'DELAY_SAMPLES', 'FILE_TIME_S', 'FREQUENCY_HZ', 'OFFSET_UM', 'SAMPLES',
    'SAMPLE_PERIOD_S', 'SHARE', 'SLEW_V_PER_S', 'TIME_S', 'VOLTAGE_V', 'WAIT_S', 'Number',
    'NumberOrWord', 'Whole', 'not_empty', 'path_type',
]

_NUMBER: Final = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?', re.ASCII)
_WHOLE: Final = re.compile(r'[-+]?\d+', re.ASCII)
_DECIMAL_COMMA: Final = re.compile(r'[-+]?\d*,\d+([eE][-+]?\d+)?', re.ASCII)


def _refused(text: str, allowed: str) -> ArgumentTypeError:
    shown = text if _NUMBER.fullmatch(text) else repr(text)
    hint = '; the decimal point is a point' if _DECIMAL_COMMA.fullmatch(text) else ''
    return ArgumentTypeError(f'is {shown}, allowed is {allowed}{hint}')


@dataclass(frozen=True)
class Number:
    """
    A finite number.

    Attributes
    ----------
    least, most : float
        What is allowed, both included.
    unit : str
        Its unit.
    is_above : bool
        Whether ``least`` itself is not allowed.

    Examples
    --------
    >>> Number(0.0, 1e3, 's', is_above=True)('1e-5')
    1e-05
    >>> Number(0.0, 1.0)('nan')
    Traceback (most recent call last):
    argparse.ArgumentTypeError: is 'nan', allowed is a number, 0 … 1

    """

    least: float
    most: float
    unit: str = ''
    is_above: bool = False

    @property
    def allowed(self) -> str:
        """What is allowed, for a message."""
        unit = f' {self.unit}' if self.unit else ''
        if self.is_above:
            return f'a number above {self.least:g}, at most {self.most:g}{unit}'
        return f'a number, {self.least:g} … {self.most:g}{unit}'

    def __call__(self, text: str) -> float:
        """Return the number that a text is."""
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not (self.least < value if self.is_above else self.least <= value) or value > self.most:
            raise _refused(text, self.allowed)
        return value


@dataclass(frozen=True)
class Whole:
    """
    A whole number.

    Attributes
    ----------
    least, most : int
        What is allowed, both included.

    Examples
    --------
    >>> Whole(1, 1000)('1e3')
    Traceback (most recent call last):
    argparse.ArgumentTypeError: is 1e3, allowed is a whole number, 1 … 1000

    """

    least: int
    most: int

    @property
    def allowed(self) -> str:
        """What is allowed, for a message."""
        return f'a whole number, {self.least} … {self.most}'

    def __call__(self, text: str) -> int:
        """Return the number that a text is."""
        # By way of float: Python reads no whole number of thousands of digits.
        if not (_WHOLE.fullmatch(text) and self.least <= float(text) <= self.most):
            raise _refused(text, self.allowed)
        return int(text)


@dataclass(frozen=True)
class NumberOrWord:
    """
    A whole number, or a word that stands for a choice of it.

    Attributes
    ----------
    number : Whole
        The numbers that are allowed.
    word : str
        The word.

    """

    number: Whole
    word: str

    def __call__(self, text: str) -> str:
        """Return the text, if it is one of them."""
        if text == self.word:
            return text
        try:
            return str(self.number(text))
        except ArgumentTypeError:
            raise _refused(text, f"{self.number.allowed}, or '{self.word}'") from None


def path_type(text: str) -> Path:
    """Return the path that a text is; an empty one would be the working directory."""
    return Path(not_empty(text))


def not_empty(text: str) -> str:
    """Return a text that is not empty."""
    if not text:
        raise ArgumentTypeError("is '', which is empty; give a value, or leave it out")
    return text


SAMPLE_PERIOD_S: Final = Number(1e-9, 1e3, 's')
FREQUENCY_HZ: Final = Number(1e-6, 1e9, 'Hz')
AMPLITUDE_UM: Final = Number(0.0, 1e4, 'um', is_above=True)
OFFSET_UM: Final = Number(-1e4, 1e4, 'um')
VOLTAGE_V: Final = Number(-1e3, 1e3, 'V')
SLEW_V_PER_S: Final = Number(0.0, 1e9, 'V/s', is_above=True)
SHARE: Final = Number(0.0, 1.0)
TIME_S: Final = Number(0.0, 1e9, 's')  # of a run
FILE_TIME_S: Final = Number(-1e12, 1e12, 's')  # of a file, which may count from any year
WAIT_S: Final = Number(0.0, 1e6, 's', is_above=True)
DELAY_SAMPLES: Final = Whole(0, 1000)
COUNT: Final = Whole(1, 1_000_000)
SAMPLES: Final = Whole(64, 10_000_000)
