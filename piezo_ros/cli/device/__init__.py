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

"""``piezo device``: what is attached, a loop from output to input, the scale of the sensor."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from piezo_ros.cli.shared.drive_question import ask_to_drive
from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED
from piezo_ros.cli.shared.option_types import (
    SAMPLE_PERIOD_S,
    SAMPLES,
    SLEW_V_PER_S,
    VOLTAGE_V,
    Number,
)
from piezo_ros.hardware.calibration import Calibration, sensor_v, two_point_calibration
from piezo_ros.hardware.checks.loopback import measure_loopback
from piezo_ros.hardware.chosen_device import choose_device
from piezo_ros.hardware.device import Device, DeviceError
from piezo_ros.interruption import holding_interruption
from piezo_ros.model.parameters import ParameterError
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.hardware_file import read_hardware
from piezo_ros.parameters.hardware_parameters import DEVICES, HardwareParameters

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
FILE is a ROS parameter file with a section /**/plant that has a device, see docs/hardware.md.

examples:
  piezo device list                         cards of this machine's driver
  piezo device list --address 10.0.0.5:31763
  piezo device loopback stage.yaml          output wired to input, no amplifier connected
  piezo device calibrate stage.yaml --at-v 0.5 9.5 --um 0.61 11.42
"""
_AMPLITUDE_V: Final = Number(0.0, 1e3, 'V', is_above=True)
_DISPLACEMENT_UM: Final = Number(-1e6, 1e6, 'um')
_READINGS: Final = 1000
_SETTLE_S: Final = 0.5
_MOST_SETTLING: Final = 10**6  # samples
_SIGMAS: Final = 20.0  # by which the two points of a calibration must differ at least


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    tasks = parser.add_subparsers(dest='task', required=True, metavar='TASK')
    listing = tasks.add_parser('list', help='what is attached')
    listing.add_argument(
        '--address', type=str, default='', metavar='HOST:PORT',
        help='of a device server (default: the local '
        'driver)')
    listing.set_defaults(function=_list)
    loopback = tasks.add_parser(
        'loopback', help='delay and gain from the output to the input, wired together')
    loopback.add_argument(
        '--amplitude-v', type=_AMPLITUDE_V, default=0.5, metavar='A',
        help='of the block (default: 0.5)')
    loopback.add_argument(
        '--samples', type=SAMPLES, default=4096, metavar='N', help='of the block (default: 4096)')
    loopback.set_defaults(function=_loopback)
    calibrate = tasks.add_parser(
        'calibrate', help='scale and offset of the sensor from two known displacements')
    calibrate.add_argument(
        '--at-v', type=VOLTAGE_V, nargs=2, required=True, metavar=('LOW', 'HIGH'),
        help='amplifier inputs to go to, volts')
    calibrate.add_argument(
        '--um', type=_DISPLACEMENT_UM, nargs=2, metavar=('LOW', 'HIGH'),
        help='displacements there by another instrument (default: asked for)')
    calibrate.set_defaults(function=_calibrate)
    for task in (loopback, calibrate):
        task.add_argument('file', type=Path, metavar='FILE', help='parameter file of the plant')
        task.add_argument(
            '--sample-period-s', type=SAMPLE_PERIOD_S, default=1e-5, metavar='T',
            help='sample period (default: 1e-5)')
        task.add_argument(
            '--slew-v-per-s', type=SLEW_V_PER_S, default=100.0, metavar='S',
            help='of the ramps (default: 100)')
        task.add_argument(
            '--yes', action='store_true', help='drive a real output without asking')


def _list(options: argparse.Namespace) -> int:
    from piezo_ros.hardware.ni import attached_cards
    print(f'devices of this package: {", ".join(DEVICES)}, or MODULE:CLASS for one of your own')
    where = options.address or 'the local driver'
    try:
        cards = attached_cards(options.address)
    except DeviceError as error:
        print(f'ni at {where}: {error}')
        return EXIT_FAILED if options.address else EXIT_DONE
    print(f'ni at {where}: {len(cards)} cards with an output')
    for card in cards:
        print(f'  {card}')
    return EXIT_DONE


@contextmanager
def _at_rest(options: argparse.Namespace, hardware: HardwareParameters) -> Iterator[Device]:
    """Yield the device of a file, open and at rest, and leave it there whatever happens."""
    if hardware.is_real and not options.yes:
        ask_to_drive(f'{hardware.device} {hardware.output_channel}')
    try:
        device = choose_device(hardware.device, hardware.to_mapping())
    except ParameterError as error:
        raise PlanError(f'{options.file}: {error}') from None
    with holding_interruption() as interruption:  # No signal cuts a ramp off.
        try:
            device.open(options.sample_period_s)
            device.ramp_to(0.0, options.slew_v_per_s)
            try:
                with interruption.released():
                    yield device
            finally:
                device.ramp_to(0.0, options.slew_v_per_s)
        finally:
            device.close()


def _loopback(options: argparse.Namespace) -> int:
    hardware = read_hardware(options.file)
    try:
        with _at_rest(options, hardware) as device:
            c = device.constraints
            most_v = min(-c.lowest_voltage_v, c.highest_voltage_v)
            if not 0.0 < options.amplitude_v <= most_v:
                raise PlanError(
                    f'--amplitude-v is {options.amplitude_v} V, it must be above 0, and the rails '
                    f'allow {most_v:g} V')
            found = measure_loopback(
                device, options.amplitude_v, options.samples, hardware.sensor_scale_um_per_v)
    except DeviceError as error:
        return _failed(error)
    print(
        f'{c.identity}\ndelay     {found.delay_samples} samples\ngain      {found.gain:.6f}\n'
        f'offset    {1e3 * found.offset_v:.3f} mV\nresidual  {1e3 * found.residual_v:.4f} mV rms')
    if found.problem:
        return _failed(found.problem)
    print('in order: each reading answers the voltage of one sample before')
    return EXIT_DONE


def _failed(why: Exception | str) -> int:
    print(f'piezo: {why}', file=sys.stderr)
    return EXIT_FAILED


def _check_points(options: argparse.Namespace, hardware: HardwareParameters) -> None:
    """Refuse two points that cannot tell a scale, before anything is driven."""
    low_v, high_v = hardware.voltage_minimum_v, hardware.voltage_maximum_v
    for input_v in options.at_v:
        if not low_v <= input_v <= high_v:
            raise PlanError(f'--at-v is {input_v} V, allowed is {low_v:g} … {high_v:g} V')
    if options.at_v[0] == options.at_v[1]:
        raise PlanError(f'--at-v is {input_v} V twice, two different points are needed')
    if options.um is None:
        if not (sys.stdin and sys.stdin.isatty()):
            raise PlanError('give --um LOW HIGH, there is no terminal to ask on')
        return
    if options.um[0] == options.um[1]:
        raise PlanError(f'--um is {options.um[0]:g} um twice, two different points are needed')


def _calibrate(options: argparse.Namespace) -> int:
    hardware = read_hardware(options.file)
    _check_points(options, hardware)
    try:
        with _at_rest(options, hardware) as device:
            calibration = Calibration.among(hardware.to_mapping())
            (low_v, low_um, low_noise_v), (high_v, high_um, high_noise_v) = [
                _at_point(device, calibration, hardware, options, which) for which in range(2)]
    except DeviceError as error:
        return _failed(error)
    noise_v = max(low_noise_v, high_noise_v)
    if not abs(high_v - low_v) > _SIGMAS * noise_v:
        return _failed(
            f'the sensor gives {low_v:.6f} V and {high_v:.6f} V, which differ by less than '
            f'{_SIGMAS:g} times the noise of {noise_v:.2g} V: no scale can be made of that')
    try:
        scale_um_per_v, offset_v = two_point_calibration(
            low_v, low_um, high_v, high_um, operating_point_um=hardware.operating_point_um)
    except ValueError as error:
        raise PlanError(str(error)) from None
    print('# for the section /**/plant of the parameter file')
    print(f'sensor_scale_um_per_v: {scale_um_per_v:.8g}')
    print(f'sensor_offset_v: {offset_v:.8g}')
    return EXIT_DONE


def _at_point(
    device: Device, calibration: Calibration, hardware: HardwareParameters,
    options: argparse.Namespace, which: int,
) -> tuple[float, float, float]:
    """Go to one of the two points; return volts of the sensor, displacement and noise there."""
    input_v = options.at_v[which]
    device.ramp_to(input_v - hardware.operating_point_v, options.slew_v_per_s)
    held_v = device.hold()
    samples = _READINGS + min(round(_SETTLE_S / options.sample_period_s), _MOST_SETTLING)
    samples = min(samples, device.constraints.most_samples or samples)
    # The stage settles in the first of them.
    readings_um = device.play(np.full(samples, held_v))[-min(_READINGS, samples):]
    volts = sensor_v(calibration, readings_um)
    um = options.um[which] if options.um else _asked(f'displacement at {input_v:g} V [um]: ')
    print(f'{input_v:g} V: sensor {volts.mean():.6f} V, {um:g} um', file=sys.stderr)
    return float(volts.mean()), um, float(volts.std())


def _asked(question: str) -> float:
    print(question, end='', file=sys.stderr, flush=True)
    line = sys.stdin.readline().strip()
    try:
        return float(line)
    except ValueError:
        raise PlanError(f'the displacement is {line!r}, it must be a number') from None
