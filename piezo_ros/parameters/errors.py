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

__all__ = ['CampaignError', 'PlanError', 'failure_text']


class PlanError(ValueError):
    """A plan or another input file that cannot be used; the text names file, key and value."""


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
        return str(error) or 'out of memory'
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f'{os.fsdecode(error.filename)}: {error.strerror}'
    return str(error)
