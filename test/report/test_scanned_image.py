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
"""Images of two recorded axes: brought together by index, without the noise that is known."""

import numpy as np
import pytest

from piezo_ros.bag.recorded_run import Run, Samples
from piezo_ros.model.noise import unit_noise
from piezo_ros.parameters.node_parameters import check_node_parameters
from piezo_ros.report.scanned_image import scanned_image, tip_um

LINES, SAMPLES = 12, 200
NOISE_UM, SEED = 0.002, 5


def run(tmp_path, reference_um, displacement_um, *, start=0, period_s=1e-5, plant=None):
    return Run(
        path=tmp_path / 'bag', namespace='/', sample_period_s=period_s, start_index=start,
        samples=reference_um.size, parameters={'/plant': plant} if plant else {}, metadata={},
        lost=(), topics=(), _streams={
            'reference': Samples(start, reference_um),
            'displacement': Samples(start, displacement_um)})


def plant(**values):
    return check_node_parameters('plant', {'noise_rms_um': NOISE_UM, 'seed': SEED, **values})


@pytest.fixture
def references():
    turns = np.arange((LINES + 1) * SAMPLES) / SAMPLES
    fast_um = 4.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))
    return fast_um, 3.2 * (turns / LINES - 0.5)


def image(fast, slow, **settings):
    return scanned_image(
        fast, slow, name='a', case='case', variant='variant', bags=('x', 'y'),
        **{'pixels': 32, **settings})


def test_the_known_noise_of_a_simulated_rig_moves_no_tip(tmp_path, references):
    noisy = [
        values + NOISE_UM * unit_noise(SEED, 0, values.size) for values in references]
    fast, slow = (
        run(tmp_path, reference, values, plant=plant())
        for reference, values in zip(references, noisy, strict=True))
    made = image(fast, slow)
    assert made.noise_removed
    assert made.quality.rms_px < 1e-9 < 0.01 < made.measured_rms_px
    unknown = image(*(
        run(tmp_path, reference, values)
        for reference, values in zip(references, noisy, strict=True)))
    assert not unknown.noise_removed
    assert unknown.quality.rms_px == pytest.approx(made.measured_rms_px)


def test_noise_that_is_not_in_the_displacement_is_not_taken_away(tmp_path, references):
    reference_um = references[0]
    noisy_um = reference_um + NOISE_UM * unit_noise(SEED, 0, reference_um.size)
    assert tip_um(run(tmp_path, reference_um, noisy_um, plant=plant(seed=SEED + 1))) is None
    assert tip_um(run(tmp_path, reference_um, reference_um, plant=plant())) is None
    assert tip_um(run(tmp_path, reference_um, noisy_um, plant={'channel': 'ai0'})) is None


def test_the_noise_of_a_part_is_that_of_its_indices(tmp_path, references):
    reference_um = references[0][300:]
    noisy_um = reference_um + NOISE_UM * unit_noise(SEED, 300, reference_um.size)
    np.testing.assert_allclose(
        tip_um(run(tmp_path, reference_um, noisy_um, start=300, plant=plant())), reference_um,
        atol=1e-12)


def test_axes_are_paired_by_index(tmp_path, references):
    fast_um, slow_um = references
    fast = run(tmp_path, fast_um[40:], fast_um[40:], start=40)
    slow = run(tmp_path, slow_um[:-30], slow_um[:-30])
    made, whole = image(fast, slow), image(*(
        run(tmp_path, values, values) for values in references))
    assert made.quality.rms_px < 1e-9
    assert made.images.samples[0] == whole.images.samples[0]
    assert made.line_rate_hz == pytest.approx(500.0, rel=0.05)
    assert made.record()['first_sample'] == made.images.samples[0]


def test_axes_that_were_not_in_lockstep_are_refused(tmp_path, references):
    fast_um, slow_um = references
    fast = run(tmp_path, fast_um, fast_um)
    with pytest.raises(ValueError, match=r'sample_period_s is 1e-05 s in .* and 2e-05 s in'):
        image(fast, run(tmp_path, slow_um, slow_um, period_s=2e-5))
    with pytest.raises(ValueError, match='no index in common'):
        image(fast, run(tmp_path, slow_um, slow_um, start=10**6))
