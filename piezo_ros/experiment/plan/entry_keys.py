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

"""Keys of a plan's mappings: what is none is refused, with what was probably meant."""

from collections.abc import Mapping, Sequence
from typing import Any

from piezo_ros.parameters.errors import PlanError
from piezo_ros.suggestions import did_you_mean

__all__ = ['refuse_unknown']


def refuse_unknown(
    where: str, content: Mapping[str, Any], known: Sequence[str], of: str = '',
) -> None:
    """
    Refuse a key that a mapping of a plan cannot have.

    Parameters
    ----------
    where : str
        What the error begins with.
    content : mapping of str to value
        The mapping.
    known : sequence of str
        The keys that it may have.
    of : str, optional
        What it is, in words after the key.

    Raises
    ------
    PlanError
        For the first such key.

    """
    for key in content:
        if key not in known:
            raise PlanError(
                f'{where}: unknown key {key!r}{of}; allowed are {", ".join(known)}'
                f'{did_you_mean(key, known)}')
