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

"""Feedback beside a planned scan: what it costs, what it removes, what learning must know of it."""

import numpy as np
import pytest
from running_scan import LAW, PERIOD_S, RIG, known_scan, played

from piezo_ros.control import ControllerParameters
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.control.pi_controller import PiController
from piezo_ros.experiment.planned_scan import stage_of
from piezo_ros.experiment.scan_beside_feedback import ScanBesideFeedback
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.planning.aligned_feedback import check_aligned, filtered, periodic_sensitivity

LEAD = LAW.replaced(
    proportional_gain=0.4, integral_gain_per_s=1300.0, lead_zero_hz=600.0, lead_pole_hz=6000.0)
REPETITIONS = 8


def last_um(scan, plan, law, rig=RIG, repetitions=REPETITIONS, disturbance_um=None):
    """Return reference and displacement of the last repetitions of a run, shape (2, N)."""
    table = scan.motion(plan)
    samples = table.repeat_from + (repetitions + 4) * plan.reference_um.size
    reference_um, command_um = played(table, samples)
    hysteresis = scan.request.hysteresis
    if disturbance_um is None:
        displacement_um = run_loop(
            rig, hysteresis, law, PERIOD_S, reference_um, command_um).displacement_um[:-1]
    else:
        controller, inverse = PiController(law, PERIOD_S), InverseHysteresis(hysteresis)
        stage, displacement_um = Rig(rig, PERIOD_S), np.empty(samples)
        reading_um = stage.measure()
        for k in range(samples):
            displacement_um[k] = reading_um + disturbance_um(k * PERIOD_S)
            one = slice(k, k + 1)
            answer_um = controller.answer(
                k, reference_um[one], command_um[one], displacement_um[one])
            reading_um = float(stage.run(inverse.answer(k, answer_um))[0])
    last = slice(-repetitions * plan.reference_um.size, None)
    return np.array([reference_um[last], displacement_um[last]])


def nrmse_percent(streams):
    reference_um, displacement_um = streams
    return 100.0 * float(
        np.sqrt(np.mean((reference_um - displacement_um)**2)) / np.ptp(reference_um))


def measured_percent(cell, law, **arguments):
    scan = ScanBesideFeedback(*known_scan(*cell, wrong=False), law)
    return nrmse_percent(last_um(scan, scan.learner.plan, law, **arguments))


@pytest.mark.parametrize('law', [LAW, LEAD], ids=['PI', 'PI and lead'])
@pytest.mark.parametrize('cell', [(1.0, 500.0), (2.5, 800.0)])
def test_aligned_feedback_costs_nothing(cell, law):
    alone = measured_percent(cell, LAW.replaced(scheme='ff'))
    assert measured_percent(cell, law) <= alone + 0.02


def test_where_slew_binds_the_reference_as_it_is_would_cost():
    law, cell = LEAD, (2.5, 800.0)
    scan = ScanBesideFeedback(*known_scan(*cell, wrong=False), law)
    assert scan.compares_with_plan
    fed = nrmse_percent(last_um(scan, scan.learner.plan, law))
    scan.compares_with_plan = False
    assert nrmse_percent(last_um(scan, scan.learner.plan, law)) > fed + 0.1


def test_drift_and_a_disturbance_are_removed():
    cell = (1.0, 500.0)
    nominal = measured_percent(cell, LAW)
    assert measured_percent(cell, LAW, rig=RIG.replaced(drift_um_per_s=0.2)) <= nominal + 0.02


@pytest.mark.slow
def test_twenty_nanometres_at_fifty_hertz_are_removed():
    def disturbance_um(time_s):
        return 0.02 * np.sin(2.0 * np.pi * 50.0 * time_s)

    cell = (1.0, 300.0)
    arguments = {'repetitions': 6, 'disturbance_um': disturbance_um}
    assert measured_percent(cell, LAW.replaced(scheme='ff'), **arguments) > 0.6
    assert measured_percent(cell, LAW, **arguments) <= 0.10


@pytest.mark.parametrize('law', [LAW, LEAD], ids=['PI', 'PI and lead'])
def test_a_small_change_of_the_command_comes_through_by_the_sensitivity(law):
    """Where no limit binds, y moves by S of what it moves by without feedback."""
    rig = RIG.replaced(
        slew_limit_v_per_s=0.0, noise_rms_um=0.0, dac_bits=0, adc_bits=0)
    request, plan = known_scan(1.0, 500.0, wrong=False)
    plan_moved = plan.with_coefficients(1.003 * plan.coefficients_v, stage_of(request))
    moved = {}
    for each in (LAW.replaced(scheme='ff'), law):
        scan = ScanBesideFeedback(request, plan, each)
        scan.compares_with_plan = False
        moved[each.scheme] = (
            last_um(scan, plan_moved, each, rig, 1)[1] - last_um(scan, plan, each, rig, 1)[1])
    sensitivity = periodic_sensitivity(stage_of(request), law, PERIOD_S)
    expected_um = filtered(sensitivity, moved['ff'])
    difference_um = moved['fbff'] - expected_um
    assert np.sqrt(np.mean(difference_um**2)) < 0.1 * np.sqrt(np.mean(expected_um**2))
    assert np.sqrt(np.mean((moved['ff'] - expected_um)**2)) > 0.3 * np.sqrt(
        np.mean(expected_um**2))


@pytest.mark.parametrize(('law', 'culprit'), [
    (ControllerParameters(), 'reference_delay_samples is 0, .* must equal'),
    (ControllerParameters(scheme='open_loop'), "scheme is 'open_loop'"),
])
def test_a_controller_that_works_against_the_plan_is_refused(law, culprit):
    with pytest.raises(ValueError, match=culprit):
        check_aligned(law)
