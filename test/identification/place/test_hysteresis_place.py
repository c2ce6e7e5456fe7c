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

"""Which poles are before the hysteresis, told by records of stages simulated here."""

import math

import numpy as np
import pytest
import yaml
from scipy.signal import cont2discrete, lfilter

from piezo_ros.control.tables.excitation import stepped_sine
from piezo_ros.identification.place.hysteresis_place import (
    Candidate,
    HysteresisPlace,
    TimeRecord,
    decide_hysteresis_place,
)
from piezo_ros.identification.place.placed_file import placed_parameter_yaml
from piezo_ros.identification.place.placed_stage import (
    Factors,
    Placement,
    placements,
    simulate_placed,
)
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    MaxwellResistiveCapacitor,
)

PERIOD_S = 1e-4
FINE = 16
LAG = (2.0 * math.pi * 400.0,)
AMPLIFIER = (2.0 * math.pi * 900.0, 0.6)
MODE = (2.0 * math.pi * 1200.0, 0.05)
HYSTERESIS = HysteresisParameters()


def section(values, coefficients):
    """Pass values through 1/(c0 + c1 s + ...) in steps of the fine grid, held in each."""
    numerator, denominator, _ = cont2discrete(
        ([1.0], coefficients[::-1]), PERIOD_S / FINE, method='zoh')
    return lfilter(numerator.ravel(), denominator, values)


def played(before, behind, amplitude_um=0.8, noise_um=2e-3):
    """Play a compensated stepped sine on a stage and return its record."""
    operator = MaxwellResistiveCapacitor()
    command = stepped_sine(
        np.geomspace(60.0, 2200.0, 14), amplitude_um, PERIOD_S, dwell_s=0.04).command
    voltage_v = operator.inverse(command)[0]
    signal = np.repeat(voltage_v, FINE)
    for each in before:
        signal = section(signal, each)
    signal = operator.forward(signal)[0]
    for each in behind:
        signal = section(signal, each)
    noise_um = noise_um * np.random.default_rng(4).normal(size=voltage_v.size)
    return TimeRecord(voltage_v, signal[::FINE] + noise_um, PERIOD_S)


def lag(rate):
    return (1.0, 1.0 / rate)


def pair(frequency, damping):
    return (1.0, 2.0 * damping / frequency, 1.0 / frequency**2)


IDENTIFIED = Factors(0.99, (1.04 * LAG[0],), ((0.995 * MODE[0], 1.1 * MODE[1]),))


def test_d1_a_lag_before_the_hysteresis_is_found_to_be_there():
    place = decide_hysteresis_place(
        [played([lag(*LAG)], [pair(*MODE)])], HYSTERESIS, IDENTIFIED)
    assert place.is_decided
    assert (place.rates_before, place.pairs_before) == ({0}, set())
    assert place.candidates[0].factors.rates_rad_per_s[0] == pytest.approx(LAG[0], rel=0.01)
    assert place.misfit_um < 4e-3


@pytest.mark.slow
def test_d1_a_lag_behind_the_hysteresis_is_found_to_be_there():
    place = decide_hysteresis_place(
        [played([], [lag(*LAG), pair(*MODE)])], HYSTERESIS, IDENTIFIED)
    assert place.is_decided
    assert (place.rates_before, place.pairs_before) == (set(), set())


@pytest.mark.slow
def test_d1_a_pair_before_the_hysteresis_is_found_also_if_it_is_listed_last():
    place = decide_hysteresis_place(
        [played([pair(*AMPLIFIER)], [lag(*LAG), pair(*MODE)])], HYSTERESIS,
        Factors(0.99, (1.02 * LAG[0],), (MODE, AMPLIFIER)))
    assert place.is_decided
    assert (place.rates_before, place.pairs_before) == (set(), {1})


@pytest.mark.slow
def test_a_lag_that_is_too_fast_to_matter_is_undecided_and_harmless():
    fast = 2.0 * math.pi * 30e3
    place = decide_hysteresis_place(
        [played([lag(fast)], [pair(*MODE)])], HYSTERESIS, Factors(0.99, (fast,), (MODE,)))
    assert not place.is_decided
    assert {each.rates_before for each in place.candidates} >= {frozenset(), frozenset({0})}
    assert place.spread_percent < 0.5
    assert 'undecided among' in str(place)


@pytest.mark.slow
def test_with_a_hysteresis_that_is_wrong_the_place_is_right_or_undecided():
    generator = np.random.default_rng(1)
    before, behind = (
        played([lag(*LAG)], [pair(*MODE)]), played([], [lag(*LAG), pair(*MODE)]))
    for _ in range(3):
        kappa, saturation = (
            np.array(values) * (1.0 + 0.1 * generator.normal(size=len(values)))
            for values in (HYSTERESIS.kappa_um_per_v, HYSTERESIS.saturation_v))
        wrong = HysteresisParameters(
            kappa_um_per_v=tuple(kappa.tolist()), saturation_v=tuple(saturation.tolist()))
        for record, truth in ((before, {0}), (behind, set())):
            place = decide_hysteresis_place([record], wrong, IDENTIFIED)
            assert not place.is_decided or place.rates_before == truth


def test_every_placement_without_hysteresis_is_the_same_linear_stage():
    class Linear:
        def forward(self, voltage_v, state=None):
            return np.asarray(voltage_v), state

    factors = Factors.of(DynamicsParameters())
    voltage_v = np.repeat(np.random.default_rng(0).normal(size=200), 20)
    system = LinearDynamics().discrete(1e-5)
    state, expected = np.zeros((5, 1)), []
    for value in voltage_v.tolist():
        expected.append((system.c @ state).item())
        state = system.a @ state + system.b * value
    for placement in placements(factors):
        found = simulate_placed(factors, placement, Linear(), voltage_v, 1e-5)
        exact = placement == Placement()
        assert np.std(found - expected) < (1e-9 if exact else 2e-3) * np.std(expected)


def test_a_record_that_is_too_short_is_refused():
    short = TimeRecord(np.zeros(50), np.zeros(50), PERIOD_S)
    with pytest.raises(ValueError, match='a record of 50 samples is too short to tell'):
        decide_hysteresis_place([short], HYSTERESIS, IDENTIFIED)


FILE = """\
/**/trajectory:
  ros__parameters:
    natural_frequency_1_rad_per_s: 7500.0  # standard error 1
    damping_ratio_1: 0.05  # standard error 2
    natural_frequency_2_rad_per_s: 5600.0  # standard error 3
    damping_ratio_2: 0.6  # standard error 4
/**/identified_dynamics:
  ros__parameters:
    verdict: 'good'
    natural_frequency_1_rad_per_s_standard_error: 1.0
    natural_frequency_2_rad_per_s_standard_error: 3.0
"""


def pair_before(is_decided):
    best = Candidate(
        frozenset(), frozenset({1}), 2e-3,
        Factors(0.98, (2500.0,), (MODE, AMPLIFIER), (1.0, -1e-5, 1e-9)))
    other = Candidate(frozenset(), frozenset(), 2e-3, best.factors)
    return HysteresisPlace(
        best.rates_before, best.pairs_before, is_decided, (best, other)[:2 - is_decided], 2e-3,
        1.0, 0.0)


def test_d1_the_pair_before_the_hysteresis_becomes_the_first_of_the_file():
    place = pair_before(is_decided=False)
    found = yaml.safe_load(placed_parameter_yaml(FILE, place))
    parameters, facts = (
        found[f'/**/{node}']['ros__parameters'] for node in ('trajectory', 'identified_dynamics'))
    assert parameters == {
        'natural_frequency_1_rad_per_s': 5600.0, 'damping_ratio_1': 0.6,
        'natural_frequency_2_rad_per_s': 7500.0, 'damping_ratio_2': 0.05,
        'rates_before_hysteresis': 0, 'pairs_before_hysteresis': 1,
        'hysteresis_place': 'undecided'}
    assert facts['natural_frequency_1_rad_per_s_standard_error'] == 3.0
    assert facts['place_misfit_um'] == place.misfit_um
    assert len(facts['place_candidates']) == 2


def test_d1_listed_poles_before_the_hysteresis_become_the_first_of_the_file():
    text = (
        '/**/trajectory:\n  ros__parameters:\n    dynamics: sections\n'
        '    pole_frequencies_rad_per_s: [7500.0, 5600.0]  # of pairs\n'
        '    pole_damping_ratios: [0.05, 0.6]\n    pairs_before_hysteresis: 0\n')
    found = yaml.safe_load(placed_parameter_yaml(text, pair_before(is_decided=False)))
    parameters = found['/**/trajectory']['ros__parameters']
    assert parameters['pole_frequencies_rad_per_s'] == [5600.0, 7500.0]
    assert parameters['pole_damping_ratios'] == [0.6, 0.05]
    assert parameters['pairs_before_hysteresis'] == 1
    assert 'place_candidates' in found['/**/identified_dynamics']['ros__parameters']


def test_where_the_place_is_decided_the_file_gets_the_refined_dynamics():
    place = pair_before(is_decided=True)
    text = DynamicsParameters().to_mapping()
    lines = ''.join(f'    {name}: {value!r}\n' for name, value in text.items()
                    if isinstance(value, float))
    found = yaml.safe_load(placed_parameter_yaml(
        '/**/trajectory:\n  ros__parameters:\n' + lines, place))['/**/trajectory']
    values = {name: float(value) for name, value in found['ros__parameters'].items()
              if name in text and isinstance(text[name], float)}
    refined = Factors.of(DynamicsParameters.from_mapping(values))
    factors = place.candidates[0].factors
    assert refined.pairs == (AMPLIFIER, MODE)
    assert refined.rates_rad_per_s == pytest.approx(factors.rates_rad_per_s)
    assert refined.zeros == pytest.approx(factors.zeros)
    assert refined.gain == pytest.approx(factors.gain)
    assert found['ros__parameters']['hysteresis_place'] == 'known'
