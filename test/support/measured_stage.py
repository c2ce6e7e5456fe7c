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
A stage that shares nothing with the package: plays with a curved characteristic, and a resonance.

A D/A output steps through the samples of a voltage in 0 … 120 V. An amplifier of one pole follows
it, 24 plays and a cubic make the displacement at rest, a resonance of 170 Hz answers. Its
measurement is written as a lab writes it: milliseconds, the input of the amplifier in volts,
nanometres with an offset, semicolons and decimal commas.
"""

from pathlib import Path

import numba
import numpy as np

SAMPLE_RATE_HZ = 2500.0
AMPLIFIER_GAIN = 15.0
BIAS_V = 4.0  # at the input of the amplifier
OFFSET_UM = 50.2
TRIANGLE_S = 6.5
NOISE_UM = 0.004
_SUBSTEPS = 20
_PLAYS = 24


@numba.njit(cache=True)
def _respond(voltage_v, substeps, step_s, radii_v, weights, cubic, pole_s, omega, damping):
    displacement = np.empty(voltage_v.size)
    plays = np.zeros(radii_v.size)
    amplified = voltage_v[0]
    position = speed = 0.0
    for k in range(voltage_v.size):
        displacement[k] = position
        for _ in range(substeps):
            amplified += step_s / pole_s * (voltage_v[k] - amplified)
            rest = 0.0
            for i in range(radii_v.size):
                plays[i] = min(max(plays[i], amplified - radii_v[i]), amplified + radii_v[i])
                rest += weights[i] * plays[i]
            rest += cubic * rest * rest
            speed += step_s * (omega * omega * (rest - position) - 2 * damping * omega * speed)
            position += step_s * speed
    return displacement


def stage_displacement_um(voltage_v, sample_rate_hz=SAMPLE_RATE_HZ):
    """Return the displacement at each sample, before the voltage of that sample acts."""
    radii_v = 22.0 * (np.arange(_PLAYS) / _PLAYS)**1.5
    weights = 0.10 * np.exp(-0.16 * np.arange(_PLAYS))
    weights[0] = 0.24
    return _respond(
        np.asarray(voltage_v, dtype=float), _SUBSTEPS, 1.0 / sample_rate_hz / _SUBSTEPS, radii_v,
        weights, 4e-4, 1.0 / (2 * np.pi * 1200.0), 2 * np.pi * 170.0, 0.04)


def excitation_v():
    """Return what was put on the amplifier, about the bias: triangles, then a stepped sine."""
    rate = SAMPLE_RATE_HZ
    rest = np.zeros(int(0.25 * rate))
    phase = np.arange(int(rate)) / rate
    triangle = np.interp(phase, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    triangles = [amplitude * triangle for amplitude in (3.6, 3.0, 2.4, 1.8, 1.2, 0.6)]
    sines = []
    for frequency_hz in (10, 20, 40, 70, 100, 125, 145, 160, 170, 180, 195, 220, 260, 320, 400,
                         500, 640, 750):
        samples = int(max(0.12, 8.0 / frequency_hz) * rate) + int(0.1 * rate)
        sines.append(0.15 * np.sin(2 * np.pi * frequency_hz * np.arange(samples) / rate))
    return np.concatenate([rest, *triangles, rest, *sines, rest])


def write_measurement(path: Path) -> None:
    """Write the measurement of the stage as a CSV of a lab."""
    input_v = excitation_v()
    displacement_um = stage_displacement_um(AMPLIFIER_GAIN * input_v)
    noise_um = np.random.default_rng(7).normal(0.0, NOISE_UM, input_v.size)
    position_nm = 1e3 * (OFFSET_UM + displacement_um + noise_um)
    time_ms = 1e3 * np.arange(input_v.size) / SAMPLE_RATE_HZ
    lines = ['Stage 2, capacitive sensor, open loop', '', 't [ms];U_in [V];position [nm]']
    lines += [
        f'{time:.2f};{volt:.5f};{position:.0f}'.replace('.', ',')
        for time, volt, position in zip(time_ms, BIAS_V + input_v, position_nm, strict=True)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
