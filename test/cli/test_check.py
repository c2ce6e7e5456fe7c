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

"""`piezo check` of plans; that of nodes is in test/contract/test_contract.py."""

import pytest

from piezo_ros.cli.main import main


def test_a_plan_within_its_limits_passes(plan, capsys):
    assert main(['check', str(plan)]) == 0
    out = capsys.readouterr().out
    assert '000_ff_triangle_1um_300hz\n  travel 0.9' in out
    assert '2 runs, 0 beyond what the rig can do' in out


def test_a_plan_beyond_its_limits_fails(plan, capsys):
    plan.write_text(plan.read_text().replace('periods: 5', 'periods: 5, plant: {noise_rms_um: 6}'))
    assert main(['check', str(plan)]) == 1
    out = capsys.readouterr().out
    assert 'of 6 um: BEYOND' in out
    assert '2 runs, 2 beyond' in out


@pytest.mark.parametrize(('words', 'error'), [
    (['plnt'], 'plnt is neither plant, compensator, controller nor a plan file'),
    (['plan.yaml', '--start', 'my_driver'], 'only these are started by a command'),
])
def test_what_cannot_be_checked_is_usage(words, error, capsys):
    assert main(['check', *words]) == 2
    assert error in capsys.readouterr().err


def test_a_faulty_plan_is_usage(plan, capsys):
    plan.write_text('format_version: 7')
    assert main(['check', str(plan)]) == 2
    assert 'format_version is 7' in capsys.readouterr().err
