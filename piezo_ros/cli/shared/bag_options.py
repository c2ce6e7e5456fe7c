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

"""The options of the commands that read a run from a bag, in one place."""

import argparse
from typing import Any

from piezo_ros.cli.shared.option_types import COUNT

__all__ = ['add_bag_options', 'bag_options']


def add_bag_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which run to read, and what to do with a damaged bag."""
    parser.add_argument('--namespace', metavar='NS', help='the rig, where a bag has several')
    parser.add_argument(
        '--run', type=COUNT, metavar='N',
        help='the run, counted from 1, where a bag has several one after the other')
    parser.add_argument(
        '--allow-loss', action=argparse.BooleanOptionalAction, default=True,
        help='take what is whole of a damaged bag, say what is lost, exit 3 (default); or refuse')


def bag_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return them as `piezo_ros.bag.read` and `piezo_ros.bag.open_recording` take them."""
    return {name: getattr(options, name) for name in ('namespace', 'run', 'allow_loss')}
