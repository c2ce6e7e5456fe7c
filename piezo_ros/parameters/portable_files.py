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
The files of an output that bags name, told from the bag on.

The parameters of nodes name files by where they are now. An output may be moved, or given away: a
bag in it names the files in it from its own directory on.
"""

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

__all__ = ['OUTPUT_MARKER', 'told_from_bag']

# The file that marks a directory as the output of a command.
OUTPUT_MARKER: Final = '.piezo_output'
# A path begins where no other part of a path is before it, as in a list of changes.
_BEGIN: Final = r'(?<![^\s\'"\[{,:])'


def told_from_bag(
    bag: Path, parameters: Mapping[str, Mapping[str, Any]],
) -> dict[str, dict[str, Any]]:
    """
    Return parameters in which the files of the bag's output are named from the bag on.

    Parameters
    ----------
    bag : Path
        Directory of the bag; it need not exist.
    parameters : mapping of str to mapping
        Node to parameters. Files elsewhere keep their names, and so do all where the bag is in no
        output.

    """
    place = bag.resolve()
    output = next((each for each in place.parents if (each / OUTPUT_MARKER).is_file()), None)
    if output is None:
        return {node: dict(values) for node, values in parameters.items()}
    told = f'{os.path.relpath(output, place)}{os.sep}'
    # Lists of changes are JSON, in which other letters than those of ASCII are escaped.
    names = {f'{output}{os.sep}', json.dumps(f'{output}{os.sep}')[1:-1]}
    pattern = re.compile(f'{_BEGIN}(?:{"|".join(map(re.escape, sorted(names)))})')
    return {
        node: {
            name: pattern.sub(lambda _: told, value) if isinstance(value, str) else value
            for name, value in values.items()}
        for node, values in parameters.items()}
