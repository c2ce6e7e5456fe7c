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

"""What a misspelt word or number was probably meant to be, for the end of an error message."""

import math
import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

__all__ = ['NEARLY_SAME', 'did_you_mean', 'number_meant']

NEARLY_SAME: Final = 0.85
_USUAL_NEARNESS: Final = 0.6  # that of difflib
_NUMBER: Final = re.compile(
    r'\s*([-+]?([0-9]+[.,]?[0-9]*|[.,][0-9]+)([eE][-+]?[0-9]+)?)\s*([^0-9\s.,:]\S*)?\s*')


def did_you_mean(
    word: object, allowed: Iterable[str], *, nearness: float = _USUAL_NEARNESS,
) -> str:
    """
    Return a question that ends an error message, '' where no allowed word is near.

    Parameters
    ----------
    word : object
        What was given; what is no text has no neighbours.
    allowed : iterable of str
        The words that are allowed.
    nearness : float, optional
        How near a word must be, 1 for the same one; from `NEARLY_SAME` on hardly any other word
        than a misspelt one is, and a beginning of a word is none.

    Examples
    --------
    >>> did_you_mean('frequncy_hz', ['amplitude_um', 'frequency_hz'])
    "; did you mean 'frequency_hz'?"
    >>> did_you_mean('amplitude', ['amplitude_um', 'frequency_hz'])
    "; did you mean 'amplitude_um'?"
    >>> did_you_mean('pos', ['time [s]', 'pos [nm]'])
    "; did you mean 'pos [nm]'?"
    >>> did_you_mean('pid', ['fb', 'ff'])
    ''

    """
    if not isinstance(word, str):
        return ''
    by_lower_case = {name.lower(): name for name in allowed}
    for form in (word.lower().replace('-', '_'), word.lower()):
        nearest = get_close_matches(form, by_lower_case, n=1, cutoff=nearness) or [
            name for name in by_lower_case
            if form and name.startswith(form) and nearness < NEARLY_SAME]
        if nearest:
            break
    return f'; did you mean {by_lower_case[nearest[0]]!r}?' if nearest else ''


def number_meant(value: object, unit: str = '') -> str:
    """
    Return how a text should be written as a number, for the end of an error message; else ''.

    Parameters
    ----------
    value : object
        What was given.
    unit : str, optional
        Unit of the number.

    Examples
    --------
    >>> number_meant('0,5'), number_meant('010'), number_meant('1,000.5'), number_meant('fast')
    ('; did you mean 0.5?', '; did you mean 10?', '', '')
    >>> number_meant('300 Hz', 'Hz')
    '; write the number alone, its unit is Hz'

    """
    found = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return ''
    if found[4]:
        return '; write the number alone' + (f', its unit is {unit}' if unit else '')
    number = float(found[1].replace(',', '.'))
    return f'; did you mean {number!r}?'.replace('.0?', '?') if math.isfinite(number) else ''
