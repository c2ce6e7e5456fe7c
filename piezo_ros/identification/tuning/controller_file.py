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

"""The ROS parameter file of the controller: gains, and where feedback is acceptable."""

import math
from collections.abc import Sequence
from typing import Final

from piezo_ros.identification.tuning.feedback_table import FeedbackTable
from piezo_ros.identification.tuning.loop_shape import LoopShape
from piezo_ros.identification.yaml_text import yaml_list, yaml_number

__all__ = ['controller_file']

_FORMAT_VERSION: Final = 1


def controller_file(
    shape: LoopShape, notes: Sequence[str], table: FeedbackTable | None = None,
) -> str:
    """
    Return the text of a parameter file for the controller node.

    Parameters
    ----------
    shape : LoopShape
        The loop with the gains to write.
    notes : sequence of str
        Comments at the top, one line each.
    table : FeedbackTable, optional
        Where feedback is acceptable, for the scheme auto; by default below |S| = 1, (18) in
        Liu 2015, at every amplitude.

    Returns
    -------
    str
        YAML with the digits of the gains kept.

    """
    loop = shape.loop
    lines = [
        '# PI gains (8) tuned by piezo_ros.',
        f'# model format_version: {_FORMAT_VERSION}',
        *(f'# {note}' for note in notes),
        (f'# gain margin {shape.gain_margin:.4g}, phase margin '
         f'{shape.phase_margin_deg:.4g} deg, delay margin {shape.delay_margin_s:.4g} s'),
        (f'# bandwidth {shape.bandwidth_hz:.5g} Hz, feedback acceptable below '
         f'{shape.feedback_acceptable_frequency_hz:.5g} Hz'),
        '/**/controller:',
        '  ros__parameters:',
        f'    proportional_gain: {yaml_number(loop.proportional_gain)}',
        f'    integral_gain_per_s: {yaml_number(loop.integral_gain_per_s)}',
    ]
    if loop.lead:
        lines += [
            f'    lead_zero_hz: {yaml_number(loop.lead.zero_hz)}',
            f'    lead_pole_hz: {yaml_number(loop.lead.pole_hz)}',
        ]
    acceptable_hz = shape.feedback_acceptable_frequency_hz
    if table is None and math.isfinite(acceptable_hz):
        table = FeedbackTable((0.0,), (acceptable_hz,))
    if table is not None:
        lines += [
            '    # For scheme auto: feedback is acceptable below these frequencies.',
            f'    feedback_acceptable_frequency_hz: {yaml_list(table.frequency_hz)}',
            f'    feedback_acceptable_amplitude_um: {yaml_list(table.amplitude_um)}',
        ]
    if loop.sample_period_s is not None:
        lines.append(f'    measurement_delay_samples: {loop.measurement_delay_samples}')
    return '\n'.join(lines) + '\n'
