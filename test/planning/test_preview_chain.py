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

"""Any trajectory a little ahead: the chain of inverses, run on the rig."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from piezo_ros.model import LinearDynamics, RigParameters
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.planning.preview_chain import PreviewChain, inverse_taps

PERIOD_S = 1e-5
RIG = read_parameter_set(
    Path(__file__).parents[2] / 'config' / 'rig.yaml', 'plant', RigParameters).replaced(
        noise_rms_um=0.0, dac_bits=0, adc_bits=0)
TIME_S = np.arange(3000) * PERIOD_S


def blend(share):
    """Rise from 0 to 1 with no jump of velocity and acceleration."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def raster(amplitude_um, frequency_hz, turn):
    """Return a triangle with rounded turns, a share of each half period."""
    width = round(0.5 * turn / (frequency_hz * PERIOD_S))
    time_s = np.arange(-width, TIME_S.size + width) * PERIOD_S
    triangle = amplitude_um * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * frequency_hz * time_s))
    return np.convolve(triangle, np.ones(width) / width, 'same')[width:-width]


# The rms errors are those of the reference study, nanometres.
TRAJECTORIES = {
    'a step of 2 um in 1 ms': (2.0 * blend((TIME_S - 0.005) / 0.001), 2.0),
    'an axis of a spiral': (
        2.0 * TIME_S / TIME_S[-1] * np.sin(2.0 * np.pi * 500.0 * TIME_S), 1.1),
    'a sine of 700 Hz': (
        2.0 * np.sin(2.0 * np.pi * 700.0 * TIME_S) * blend(TIME_S / 0.004), 2.2),
    'a raster with turns of 10 %': (
        raster(2.0, 300.0, 0.1) * blend(TIME_S / 0.005), 3.9),
    'stairs of 0.2 um in 0.3 ms': (
        0.2 * sum(blend((TIME_S - 0.004 * i) / 0.0003) for i in range(1, 7)), 0.6),
}


def chain(**given):
    dynamics = LinearDynamics(RIG.true_dynamics)
    return PreviewChain(
        dynamics.amplifier, RIG, dynamics.mechanics_and_sensor, PERIOD_S, **given)


def error_nm(preview_chain, reference_um):
    """Return the error of a run, but for its last samples, which need what comes after it."""
    late = preview_chain.latency
    command_um = preview_chain.answer(np.concatenate([reference_um, np.zeros(late)]))
    rig = Rig(RIG, PERIOD_S)
    first_um = rig.measure()
    readings_um = np.concatenate([
        [first_um], rig.run(InverseHysteresis(RIG).answer(0, command_um))])
    kept = reference_um.size - 2 * late
    return 1e3 * (readings_um[late:late + kept] - reference_um[:kept])


@pytest.mark.parametrize('name', TRAJECTORIES)
def test_a_stage_follows_as_in_the_study_or_better(name):
    reference_um, study_nm = TRAJECTORIES[name]
    assert np.sqrt(np.mean(error_nm(chain(), reference_um)**2)) < 1.05 * study_nm


def test_without_preview_the_zeros_outside_the_unit_circle_cannot_be_undone():
    reference_um, _ = TRAJECTORIES['a sine of 700 Hz']
    rms_nm = {
        preview: np.sqrt(np.mean(error_nm(chain(preview=preview), reference_um)**2))
        for preview in (2, 30)}
    assert rms_nm[2] > 20.0 * rms_nm[30]
    assert chain(preview=2).residual > 20.0 * chain(preview=30).residual


def test_blocks_of_any_size_give_the_same_bits():
    reference_um, _ = TRAJECTORIES['a raster with turns of 10 %']
    whole, parts = chain(), chain()
    cuts = [0, 1, 2, 37, 400, 401, 2999, 3000]
    pieces = [
        parts.answer(reference_um[start:stop])
        for start, stop in itertools.pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole.answer(reference_um))
    parts.reset()
    whole.reset()
    np.testing.assert_array_equal(parts.answer(reference_um), whole.answer(reference_um))


@pytest.mark.parametrize(('preview', 'taps'), [(-1, 10), (10, 10)])
def test_a_preview_beyond_the_taps_is_refused(preview, taps):
    with pytest.raises(ValueError, match=rf'preview is {preview}, allowed is 0 … 9'):
        inverse_taps(np.array([0.5, 0.3]), preview, taps)


def test_a_system_that_passes_no_constant_is_refused():
    with pytest.raises(ValueError, match='passes no constant'):
        inverse_taps(np.array([1.0, -1.0]), 3, 10)
