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

"""What a misspelt word was probably meant to be, for the end of an error message."""

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ['did_you_mean']


def did_you_mean(word: object, allowed: Iterable[str]) -> str:
    """
    Return a question that ends an error message, '' where no allowed word is near.

    Parameters
    ----------
    word : object
        What was given; what is no text has no neighbours.
    allowed : iterable of str
        The words that are allowed.

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
        nearest = get_close_matches(form, by_lower_case, n=1) or [
            name for name in by_lower_case if form and name.startswith(form)]
        if nearest:
            break
    return f'; did you mean {by_lower_case[nearest[0]]!r}?' if nearest else ''
