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

"""``piezo bag``: what is in a bag, what can be saved of it, its samples as a table or a motion."""

import argparse

__all__ = ['add_arguments']

_EXAMPLES = """\
examples:
  piezo bag info out/demo/bags/002_fbff_triangle_1um_300hz
  piezo bag salvage cut_bag -o whole_bag
  piezo bag import stage.csv --columns time=t:ms voltage=U:V displacement=pos:nm -o stage
  piezo bag export out/demo/bags/002_fbff_triangle_1um_300hz -o scan.csv
  piezo bag motion out/demo/bags/002_fbff_triangle_1um_300hz --command command -o again.npz
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    from piezo_ros.cli.bag import actions, motion, table_commands
    parser.epilog = _EXAMPLES
    kinds = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    for module in (actions, table_commands, motion):
        module.add_actions(kinds)
