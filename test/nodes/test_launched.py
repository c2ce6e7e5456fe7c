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

"""What the launch files start, started: two rigs at once, one of them in one process."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.bag import STREAMS, read
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
EXAMPLE = ROOT / 'docs' / 'examples' / 'gain_plant.py'


@pytest.fixture
def alone(tmp_path):
    """Return the streams of a run of the same rig that nobody disturbs."""
    def simulate(**run):
        plan = tmp_path / 'plan.yaml'
        plan.write_text(yaml.safe_dump({
            'format_version': 1, 'score_periods': 1, 'runs': [run],
            'parameter_files': [str(CONFIG / f'{name}.yaml') for name in (
                'rig', 'compensator', 'controller', 'trajectory')]}))
        bag = tmp_path / f'alone_{run["amplitude_um"]:g}'
        simulate_run(read_plan(plan).runs[0], bag)
        return read(bag)

    return simulate


def test_two_rigs_in_two_namespaces_give_the_numbers_that_they_give_alone(rig, launched, alone):
    runs = {
        'one': {'amplitude_um': 1.5, 'periods': 3.0, 'scheme': 'fbff'},
        'two': {'amplitude_um': 1.0, 'periods': 3.0, 'scheme': 'ff'}}
    started = {
        name: launched(
            namespace=f'{rig.namespace}/{name}', record='true',
            bag_directory=str(rig.directory / name), composed=composed,
            **{key: str(value) for key, value in run.items()})
        for (name, run), composed in zip(runs.items(), ('false', 'true'), strict=True)}
    assert [*started['two']] == ['recorder', 'loop']
    for name, run in runs.items():
        assert started[name]['recorder'].wait() == 0, started[name]['recorder'].output
        recorded, expected = read(rig.directory / name), alone(**run)
        for stream in STREAMS:
            np.testing.assert_array_equal(
                recorded.whole(stream)[1], expected.whole(stream)[1], err_msg=stream)
        assert {
            node.rpartition('/')[0] for node in recorded.parameters
        } == {f'{rig.namespace}/{name}'}


def test_a_foreign_plant_takes_its_place_in_the_loop(rig, launched):
    """The plant of the documentation, which knows nothing of this package."""
    bag = rig.directory / 'bag'
    plant = rig.start_file(
        EXAMPLE, '--ros-args', '-r', f'__ns:={rig.namespace}', '-p', 'required_readers:=2',
        '-p', 'gain_um_per_v:=1.25', '-p', 'delay_samples:=3')
    started = launched(
        namespace=rig.namespace, record='true', bag_directory=str(bag), without='plant',
        scheme='fbff', periods='2.0')
    assert [*started] == ['recorder', 'compensator', 'controller', 'trajectory']
    assert started['recorder'].wait() == 0, started['recorder'].output
    assert plant.wait() == 0, plant.output
    run = read(bag)
    assert run.samples == 667
    voltage_v, displacement_um = (run.whole(stream)[1] for stream in ('voltage', 'displacement'))
    np.testing.assert_array_equal(displacement_um[:4], 0.0)
    np.testing.assert_array_equal(displacement_um[4:], 1.25 * voltage_v[:-3])
    assert run.parameters[f'{rig.namespace}/plant']['delay_samples'] == 3
