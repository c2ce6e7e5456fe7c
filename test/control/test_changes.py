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

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.control.changes import (
    CHANGEABLE,
    Change,
    ChangeParameters,
    changes_text,
    parse_changes,
    segments,
    without,
)
from piezo_ros.model import HysteresisParameters, ParameterError, RigParameters

LAW = ControllerParameters()
SAMPLES = 667  # two periods of 300 Hz


def run(law=LAW, changes=()):
    return simulate(
        RigParameters(), HysteresisParameters(), law, TrajectoryParameters(periods=2.0), changes)


@pytest.mark.parametrize(('text', 'words'), [
    ('{', ["'{'", 'no JSON']),
    ('[' * 3000, ['[[[…', 'no JSON']),  # A3: deeper than Python recurses
    ('[' * 100_000, ['[[[…', 'no JSON']),
    ('{"at_sample": 3}', ['must be a list']),
    ('[3]', ['3', 'must be a mapping with at_sample']),
    ('[{"scheme": "ff"}]', ['at_sample is None']),
    ('[{"at_sample": -1, "scheme": "ff"}]', ['at_sample is -1']),
    ('[{"at_sample": true, "scheme": "ff"}]', ['at_sample is True']),
    ('[{"at_sample": 3}]', ['nothing changes at sample 3']),
    ('[{"at_sample": 3, "seed": 1}]', ['seed cannot change', 'scheme, proportional_gain']),
    ('[{"at_sample": 3, "scheme": "bang"}]', ["scheme is 'bang'"]),
    ('[{"at_sample": 3, "scheme": "auto"}]', ['scheme is auto']),
    ('[{"at_sample": 3, "proportional_gain": -1}]', ['proportional_gain is -1.0']),
    ('[{"at_sample": 3, "proportional_gain": NaN}]', ['proportional_gain is nan']),
    ('[{"at_sample": 3, "scheme": "ff"}, {"at_sample": 3, "scheme": "fb"}]',
     ['at_sample 3 after 3']),
])
def test_a_list_that_cannot_be_meant_is_refused(text, words):
    with pytest.raises(ParameterError) as caught:
        ChangeParameters(changes=text)
    for word in words:
        assert word in str(caught.value)


def test_values_that_do_not_go_together_are_refused_with_the_law_they_change():
    changes = parse_changes('[{"at_sample": 3, "command_maximum_um": 0}]')
    with pytest.raises(ParameterError, match='command_minimum_um is 0.0 um, it must be below'):
        segments(LAW.replaced(command_minimum_um=0.0), changes, SAMPLES)


def test_what_is_written_reads_again():
    entries = [{'at_sample': 0, 'scheme': 'ff'}, {'at_sample': 9, 'proportional_gain': 0.3}]
    assert parse_changes(changes_text(entries)) == (
        Change(0, {'scheme': 'ff'}), Change(9, {'proportional_gain': 0.3}))
    assert parse_changes(changes_text([])) == ()
    assert set(CHANGEABLE) > {'scheme', 'proportional_gain', 'integral_gain_per_s'}
    assert 'measurement_delay_samples' not in CHANGEABLE


@given(st.lists(st.integers(0, 900), unique=True).map(sorted), st.integers(1, 1000))
def test_the_pieces_make_up_the_whole_run_and_each_holds_what_changed_before(at, samples):
    changes = [Change(k, {'proportional_gain': float(k + 1)}) for k in at]
    pieces = segments(LAW, changes, samples)
    assert [piece.start for piece in pieces] == [0, *(k for k in at if 0 < k < samples)]
    assert [piece.stop for piece in pieces] == [*(piece.start for piece in pieces[1:]), samples]
    for piece in pieces:
        gains = [k + 1.0 for k in at if k <= piece.start]
        assert piece.law.proportional_gain == (gains[-1] if gains else LAW.proportional_gain)


def test_some_parameters_can_be_left_out():
    changes = parse_changes(json.dumps([
        {'at_sample': 1, 'scheme': 'ff'},
        {'at_sample': 2, 'scheme': 'fb', 'proportional_gain': 0.1}]))
    assert without(changes, {'scheme'}) == (Change(2, {'proportional_gain': 0.1}),)


def test_a_change_leaves_what_was_before_and_is_bumpless():
    changes = [Change(400, {'scheme': 'fb', 'proportional_gain': 0.5, 'integral_gain_per_s': 9e3})]
    before, after = run(), run(changes=changes)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(new[:400], old[:400])
    assert not np.array_equal(after.command_um[400:], before.command_um[400:])
    # The command goes on from where it was, to the rounding of the sum it is made of.
    assert after.command_um[400] == pytest.approx(after.command_um[399], abs=1e-12)


def test_changes_from_the_first_sample_on_are_another_law():
    changed = run(changes=[Change(0, {'scheme': 'fb', 'proportional_gain': 0.4})])
    same = run(LAW.replaced(scheme='fb', proportional_gain=0.4))
    for one, other in zip(changed, same, strict=True):
        np.testing.assert_array_equal(one, other)


def test_pieces_under_one_law_without_feedback_are_the_whole():
    law = LAW.replaced(scheme='ff')
    # Nothing of the controller is remembered that the cut could spoil.
    pieces = run(law, [Change(k, {'scheme': 'ff'}) for k in (1, 100, 666)])
    for one, other in zip(pieces, run(law), strict=True):
        np.testing.assert_array_equal(one, other)
