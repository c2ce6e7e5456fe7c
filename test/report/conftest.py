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

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from piezo_ros.report import score

_LAG_SAMPLES = {'fb': 30, 'ff': 3, 'fbff': 2}


def synthetic_run(
        scheme='ff', *, samples=6000, start_index=0, sample_period_s=1e-5, **metadata):
    """Return a run as the bag reader gives it: a lagging triangle with a little ripple."""
    values = {
        'scheme': scheme, 'waveform': 'triangle', 'amplitude_um': '2.0', 'frequency_hz': '300.0',
        'harmonics': '9', 'seed': '1', 'sample_period_s': repr(sample_period_s), **metadata}
    lag = _LAG_SAMPLES.get(scheme, 5)
    k = np.arange(start_index, start_index + samples)
    cycles = float(values['frequency_hz']) * sample_period_s
    amplitude_um = float(values['amplitude_um'])

    def triangle(index):
        return amplitude_um * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * cycles * index))

    reference_um = triangle(k)
    displacement_um = triangle(k - lag) + 0.004 * lag * np.sin(2 * np.pi * 11 * cycles * k)
    voltage_v = displacement_um / 1.1 + 0.2 * np.sign(np.gradient(displacement_um))
    arrays = {
        'time_s': k * sample_period_s, 'reference_um': reference_um,
        'displacement_um': displacement_um, 'voltage_v': voltage_v}

    def part(start, stop):
        return SimpleNamespace(
            **{name: getattr(run, name)[start:stop] for name in arrays})

    run = SimpleNamespace(
        samples=samples, start_index=start_index, sample_period_s=sample_period_s,
        metadata=values, parameters={}, path=Path('no-bag'), part=part, **arrays)
    return run


@pytest.fixture
def make_run():
    return synthetic_run


@pytest.fixture(scope='session')
def scored_runs():
    """Three schemes at one point of Table 4, then FF at a point the paper does not have."""
    runs = [
        score(synthetic_run(scheme), bag=f'bags/{scheme}', wall_seconds=2.5)
        for scheme in ('fb', 'ff', 'fbff')]
    other = synthetic_run('ff', waveform='sine', frequency_hz='450.0', amplitude_um='0.5')
    return [*runs, score(other, bag='bags/sine', wall_seconds=0.0)]
