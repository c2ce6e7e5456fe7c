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

"""``piezo bag info`` and ``piezo bag salvage``."""

import argparse
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import STREAMS, open_recording, salvage
from piezo_ros.bag.recording_date import recorded_utc
from piezo_ros.cli.bag.outcome import guarded
from piezo_ros.cli.shared.bag_options import add_bag_options, bag_options
from piezo_ros.cli.shared.outputs import OutputPath
from piezo_ros.parameters.role_parameters import full_name

__all__ = ['add_actions']

_UNITS: Final = {'v': 'V'}  # in the names of columns units are in lower case
_NO_DATE: Final = 'no date: a simulation without a clock, or metadata.yaml does not tell'


def add_actions(kinds: Any) -> None:
    """Describe the arguments of these actions."""
    info = kinds.add_parser('info', help='streams, samples, metadata')
    rescue = kinds.add_parser('salvage', help='a whole bag of what is whole in a damaged one')
    for action in (info, rescue):
        action.add_argument('bag', type=Path, metavar='BAG')
    add_bag_options(info)
    rescue.add_argument(
        '-o', '--output', type=Path, action=OutputPath, required=True, metavar='DIR')
    info.set_defaults(function=lambda options: guarded(_info, options))
    rescue.set_defaults(function=lambda options: guarded(_salvage, options))


def _info(options: argparse.Namespace) -> tuple[str, ...]:
    run = open_recording(options.bag, **bag_options(options))
    print(f'bag            {run.path}')
    recorded = recorded_utc(run.path)
    print(f'recorded       {f"{recorded} UTC" if recorded else _NO_DATE}')
    print(f'namespace      {run.namespace}')
    print(f'sample period  {run.sample_period_s:g} s')
    print(f'common samples {run.samples} from index {run.start_index}')
    print(f'duration       {run.samples * run.sample_period_s:g} s')
    for stream, summary in run.streams.items():
        print(
            f'  {stream:13}{summary.samples} samples from index {summary.start_index}, '
            f'{summary.minimum:.4g} … {summary.maximum:.4g} '
            f'{_UNITS.get(STREAMS[stream], STREAMS[stream])}'
            + _remapped(run.namespace, stream, summary.topic))
    for name, value in run.metadata.items():
        print(f'{name:28}{value}')
    print(f'parameters of  {", ".join(run.parameters) or "no node"}')
    for topic, why in run.facts.unlike.items():
        print(f'no stream      {topic} {why}')
    return *run.lost, *run.uneven()


def _remapped(namespace: str, stream: str, topic: str) -> str:
    return '' if topic == full_name(namespace, stream) else f', on {topic}'


def _salvage(options: argparse.Namespace) -> tuple[str, ...]:
    result = salvage(options.bag, options.output)
    for topic, count in result.messages.items():
        print(f'{topic:24} {count} messages')
    print(f'saved: {result.path}')
    return result.lost
