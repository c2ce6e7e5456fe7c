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
Actions of the options of all commands: they note what was given, and refuse what contradicts it.

`CommandParser` takes them in place of those of `argparse` of the same name. An option that takes
one value may be given twice only with the same value: which of two was meant is not known.
"""

import argparse
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from piezo_ros.parameters.errors import PlanError

__all__ = [
    'ACTIONS', 'StoredOption', 'refuse_named_option', 'refuse_same_twice', 'refuse_without_effect']

_NOTES: Final = 'given_options'  # attribute of the parsed options: destination to option and value


class _Noted(argparse.Action):
    """An option of which the parsed options tell that it was given."""

    adds_up = False  # whether another value is taken beside the first one

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any,
        option_string: str | None = None,
    ) -> None:
        """Note and check the option, then do what its kind does."""
        if option_string is not None:
            self._note(namespace, values, option_string)
        super().__call__(parser, namespace, values, option_string)
        if isinstance(kept := getattr(namespace, self.dest, None), list):
            self._check_paths(kept)

    def _note(self, namespace: argparse.Namespace, values: Any, option_string: str) -> None:
        notes = vars(namespace).setdefault(_NOTES, {})
        value = option_string if self.nargs == 0 else values
        before = notes.setdefault(self.dest, (option_string, value))[1]
        if not self.adds_up and value != before:
            raise argparse.ArgumentError(
                self, f'is given twice, as {_shown(before)} and as {_shown(value)}; give it once')

    def _check_paths(self, values: list[Any]) -> None:
        try:
            refuse_same_twice(value for value in values if isinstance(value, Path))
        except PlanError as error:
            raise argparse.ArgumentError(None, str(error)) from None


class StoredOption(_Noted, argparse._StoreAction):
    """One value, or as many as `nargs` says."""


class _StoreTrue(_Noted, argparse._StoreTrueAction):
    """A flag."""


class _Boolean(_Noted, argparse.BooleanOptionalAction):
    """A flag with its opposite."""


class _Append(_Noted, argparse._AppendAction):
    """A value of many, each after the option again; no path twice."""

    adds_up = True


class _AppendAny(_Append):
    """A value of many, each after the option again; a path may be there twice."""

    def _check_paths(self, values: list[Any]) -> None:
        """Take a path for as many bags as it is given."""


class _Extend(_Noted, argparse._ExtendAction):
    """Values of many, some after the option and more after the option again."""

    adds_up = True


# What argparse calls them, to those that take their places.
ACTIONS: Final[dict[Any, type[argparse.Action]]] = {
    None: StoredOption, 'store': StoredOption, 'store_true': _StoreTrue, 'append': _Append,
    'append_any': _AppendAny, 'extend': _Extend, argparse.BooleanOptionalAction: _Boolean,
}


def _shown(value: Any) -> str:
    return ' '.join(map(str, value)) if isinstance(value, list) else str(value)


def refuse_same_twice(paths: Iterable[Path]) -> None:
    """
    Refuse a path that is given twice, in whichever form.

    Raises
    ------
    PlanError
        If two of them are the same file or directory.

    """
    seen: dict[str, Path] = {}
    for path in paths:
        before = seen.setdefault(os.path.realpath(path), path)
        if before is not path:
            also = '' if str(before) == str(path) else f', also as {before}'
            raise PlanError(f'{path} is given twice{also}; give it once')


def refuse_without_effect(
    options: argparse.Namespace, names: Iterable[str], why: str,
) -> None:
    """
    Refuse options that were given and would be ignored.

    Parameters
    ----------
    options : argparse.Namespace
        What was parsed.
    names : iterable of str
        Destinations of the options that have no effect.
    why : str
        When they have none, as the end of the sentence.

    Raises
    ------
    PlanError
        If one of them was given.

    """
    notes = getattr(options, _NOTES, {})
    given = [notes[name][0] for name in names if name in notes]
    if given:
        have, them = ('has', 'it') if len(given) == 1 else ('have', 'them')
        raise PlanError(f'{", ".join(given)} {have} no effect {why}; leave {them} out')


def refuse_named_option(options: argparse.Namespace, error: Exception) -> None:
    """
    Refuse an option that an error of a calculation names, as a parameter.

    Parameters
    ----------
    options : argparse.Namespace
        What was parsed.
    error : Exception
        Its text may begin with the name of a parameter and ``is``.

    Raises
    ------
    PlanError
        If an option of that name was given; the text names the option.

    """
    notes = getattr(options, _NOTES, {})
    name, _, rest = str(error).partition(' ')
    if name in notes and rest.startswith('is '):
        raise PlanError(f'{notes[name][0]} {rest}') from None
