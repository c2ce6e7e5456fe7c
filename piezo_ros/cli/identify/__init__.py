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

"""``piezo identify``: models out of bags, as parameter files that the nodes load unchanged."""

import argparse
from typing import Final

from piezo_ros.cli.identify import (
    identify_creep,
    identify_dynamics,
    identify_hysteresis,
    identify_uncertainty,
)

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo identify hysteresis bags/bare_triangle -o compensator.yaml --compare --report out/loops
  piezo identify creep bags/long_step -o creep.yaml
  piezo identify dynamics bags/stepped_sine -o trajectory.yaml
  piezo identify dynamics bags/bare_sine --compensator compensator.yaml -o trajectory.yaml
  piezo identify dynamics bags/multisine --orders 4 7 --fit-delay -o trajectory.yaml
  piezo identify dynamics recorded_by_ros2_bag --trajectory played.yaml -o trajectory.yaml
  piezo identify uncertainty bags/grid_* --model trajectory.yaml -o bound.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    kinds = parser.add_subparsers(dest='kind', required=True, metavar='KIND')
    for module in (
        identify_hysteresis, identify_creep, identify_dynamics, identify_uncertainty,
    ):
        module.add_kind(kinds)
