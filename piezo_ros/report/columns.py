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

"""The columns of a table and the text of their values, for the terminal and for the page."""

from typing import Final, NamedTuple

__all__ = ['Column', 'Value', 'value_text']

Value = str | int | float | None

_UNKNOWN: Final = '–'


class Column(NamedTuple):
    """
    One column of a table.

    Attributes
    ----------
    title, unit : str
        Heading; the unit is empty for names and counts.
    format_spec : str
        Format of its numbers, such as ``'.2f'`` or ``'d'``; empty for a column of words. Numbers
        are aligned to the right, words to the left.

    """

    title: str
    unit: str = ''
    format_spec: str = ''


def value_text(value: Value, column: Column) -> str:
    """
    Return a value as text, rounded as its column asks.

    Parameters
    ----------
    value : str, int, float or None
        Words are taken as they are; None is an unknown value.
    column : Column
        The column of the value.

    Returns
    -------
    str
        A dash for an unknown value.

    """
    if value is None:
        return _UNKNOWN
    if isinstance(value, str) or not column.format_spec:
        return str(value)
    return format(value, column.format_spec)
