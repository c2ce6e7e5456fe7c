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

"""``piezo identify dynamics --place-from``: which poles are before the hysteresis."""

import argparse
from pathlib import Path

import yaml

from piezo_ros.bag import BagError, Run, open_recording
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.cli.bag_options import bag_options
from piezo_ros.model import DynamicsParameters, HysteresisParameters
from piezo_ros.parameters.parameter_file import read_parameter_set

__all__ = ['add_place_arguments', 'placed_model']


def add_place_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe the bags that tell where the hysteresis is."""
    kind.add_argument(
        '--place-from', type=Path, action='append', metavar='BAG',
        help='find out which of the poles are before the hysteresis, by voltage and displacement '
        'of this bag: of a virgin stage, at the frequencies of the poles and at amplitudes at '
        'which the hysteresis shows; the same bag will do. The hysteresis is that of '
        '--compensator, else of the compensator in the bag')


def placed_model(options: argparse.Namespace, text: str) -> str:
    """
    Return a parameter file of the dynamics with the place of the hysteresis, and print it.

    Parameters
    ----------
    options : argparse.Namespace
        The arguments of the command.
    text : str
        The file.

    Raises
    ------
    BagError
        If a bag cannot be read, does not begin with the run, or knows no hysteresis.
    ValueError
        If the bags are too short, or the file is none of the trajectory node.

    """
    if not options.place_from:
        return text
    from piezo_ros.identification.place.hysteresis_place import (
        TimeRecord,
        decide_hysteresis_place,
    )
    from piezo_ros.identification.place.placed_file import placed_parameter_yaml
    nodes = yaml.safe_load(text)
    if '/**/trajectory' not in nodes:
        raise ValueError('--place-from needs dynamics that the trajectory node has, not --orders')
    runs = [_read(path, options) for path in options.place_from]
    place = decide_hysteresis_place(
        [TimeRecord(run.voltage_v, run.displacement_um, run.sample_period_s) for run in runs],
        _hysteresis(options, runs[0]),
        DynamicsParameters.among(nodes['/**/trajectory']['ros__parameters']))
    print(f'place of the hysteresis: {place}')
    return placed_parameter_yaml(text, place)


def _read(path: Path, options: argparse.Namespace) -> Run:
    recording = open_recording(path, **bag_options(options), fill_gaps=True)
    if recording.start_index != 0:
        raise BagError(
            f'{path} begins at sample {recording.start_index}: what the hysteresis remembers of '
            'the samples before is not known')
    return recording.part(0, recording.samples, streams=('voltage', 'displacement'))


def _hysteresis(options: argparse.Namespace, run: Run) -> HysteresisParameters:
    if options.compensator:
        return read_parameter_set(options.compensator, 'compensator', HysteresisParameters)
    if recorded_node(run, 'compensator', anywhere=True) is None:
        raise BagError(
            f'{run.path} does not say the hysteresis, which must be told (--compensator FILE)')
    return recorded_parameters(run, 'compensator', HysteresisParameters)
