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

"""The plans and examples that come with the package, in ``config/``."""

import os
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Final

import piezo_ros
from piezo_ros.parameters.errors import PlanError
from piezo_ros.suggestions import did_you_mean

__all__ = ['PLAN_HELP', 'examples', 'packaged_configuration', 'packaged_plans', 'plan_path']

PLAN_HELP: Final = (
    'plan file (YAML), or the bare name of one that comes with the package: automatic, beyond, '
    'demo, paper, raster, sweep')
_PLANS: Final = 'experiments'
_EXAMPLES: Final = 'examples'


def packaged_configuration() -> Path:
    """
    Return the folder ``config`` of the sources, or where pip or colcon has installed it.

    Raises
    ------
    PlanError
        If it is not there.

    """
    package = Path(piezo_ros.__file__).resolve().parent
    places = [package.parent / 'config', *(
        parent / 'share' / 'piezo_ros' / 'config' for parent in package.parents)]
    for place in places:
        if (place / _PLANS / 'demo.yaml').is_file():
            return place
    raise PlanError(
        f'the plans of the package are not beside it: no share/piezo_ros/config above {package}')


def packaged_plans() -> dict[str, Path]:
    """
    Return the plans that come with the package, by their bare names.

    Raises
    ------
    PlanError
        If they are not installed.

    """
    return {path.stem: path for path in sorted((packaged_configuration() / _PLANS).glob('*.yaml'))}


def examples() -> dict[str, Path]:
    """
    Return what `piezo init` copies: folders, and plans with the files that they name.

    Raises
    ------
    PlanError
        If they are not installed.

    """
    kept = (packaged_configuration() / _EXAMPLES).iterdir()
    folders = sorted(path for path in kept if path.is_dir())
    return {**{folder.name: folder for folder in folders}, **packaged_plans()}


def plan_path(text: str) -> Path:
    """
    Return the file of a plan that is given on a command line, as a path or a bare name.

    Raises
    ------
    ArgumentTypeError
        If it is a bare name, and neither a file nor a plan of the package.

    """
    if not text:
        raise ArgumentTypeError("is '', which is empty; give the file or the name of a plan")
    path = Path(text)
    is_bare = os.sep not in text and not path.suffix
    if not is_bare or os.path.exists(path):
        return path
    try:
        plans = packaged_plans()
    except PlanError:
        return path
    if text not in plans:
        raise ArgumentTypeError(
            f'{text!r} is no file and no plan of the package, which has {", ".join(plans)}'
            f'{did_you_mean(text, plans)}')
    return plans[text]
