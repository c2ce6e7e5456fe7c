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

"""Errors of input files and of runs."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezo_ros.resource_limits import limit_behind

__all__ = ['CampaignError', 'PlanError', 'cause_of', 'failure_text', 'naming_file']


class PlanError(ValueError):
    """A plan, another input file or an option that cannot be used; the text names it."""


class CampaignError(RuntimeError):
    """A run that did not come to its end; the text says what happened and what is left."""


def failure_text(error: Exception) -> str:
    """
    Return one line for an error of the system, with the file that it is about.

    Parameters
    ----------
    error : Exception
        An OSError or a MemoryError; of another error the line is its text.

    """
    if isinstance(error, MemoryError):
        return str(error) or f'out of memory{limit_behind(error)}'
    if isinstance(error, OSError) and error.strerror:
        names = [
            os.fsdecode(name) for name in (error.filename, error.filename2) if name is not None]
        return ': '.join([' -> '.join(names), cause_of(error)] if names else [cause_of(error)])
    return str(error)


def cause_of(error: OSError) -> str:
    """Return what the system says of an error, without its number and its file."""
    return f'{error.strerror or error}{limit_behind(error)}'


@contextmanager
def naming_file(path: Path | str) -> Iterator[None]:
    """
    Let an error of the system name a file, which those of writing and closing do not.

    Parameters
    ----------
    path : Path or str
        The file that is written inside the context.

    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise
