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

"""The wheel in a virtual environment of its own, without ROS and away from the sources."""

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from short_plan import SHORT_PLAN

REPOSITORY = Path(__file__).resolve().parents[1]
SWEEP = """\
format_version: 1
runs: [{scheme: ff, periods: 5}]
sweep: {draws: 2, seed: 1, parameters: {plant.noise_rms_um: {uniform: [0.0, 0.001]}}}
"""
# What takes long to import, and no help needs.
HEAVY = (
    'PIL', 'control', 'jinja2', 'matplotlib', 'mcap', 'numba', 'numpy', 'rclpy', 'scipy', 'yaml')
HELP = """\
import sys
sys.argv = ['piezo', '--help']
from piezo_ros.cli.main import main
try:
    main()
finally:
    print(*sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)
"""


def imported_for_help(python, folder, environment):
    done = subprocess.run(
        [python, '-c', HELP], cwd=folder, env=environment, capture_output=True, text=True,
        check=False)
    assert 'usage: piezo' in done.stdout
    return set(done.stderr.split())


def test_help_imports_nothing_that_takes_long(tmp_path):
    imported = imported_for_help(
        sys.executable, tmp_path, {**os.environ, 'PYTHONPATH': str(REPOSITORY)})
    assert 'piezo_ros' in imported
    assert not imported & {*HEAVY}


@pytest.fixture(scope='module')
def installed(tmp_path_factory):
    """Return the folder of the programs of an environment that has the wheel and its needs."""
    folder = tmp_path_factory.mktemp('wheel')
    listed = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip(f'the sources are no git work tree: {listed.stderr.strip()}')
    for name in filter(None, listed.stdout.split('\0')):
        if (REPOSITORY / name).is_file():
            (folder / 'src' / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(REPOSITORY / name, folder / 'src' / name)
    subprocess.run(
        [sys.executable, '-m', 'pip', 'wheel', '--quiet', '--no-deps', '-w', folder,
         folder / 'src'], check=True)
    shutil.rmtree(folder / 'src')
    (wheel,) = folder.glob('*.whl')
    venv.create(folder / 'venv', with_pip=True)
    programs = folder / 'venv' / 'bin'
    subprocess.run(
        [programs / 'python', '-m', 'pip', 'install', '--quiet', wheel], cwd=folder, check=True,
        env=without_paths())
    return programs


def without_paths():
    """Return the environment without what leads to the sources, to ROS or to other packages."""
    return {
        name: value for name, value in os.environ.items()
        if not name.startswith(('PYTHON', 'AMENT', 'ROS', '_ROS', 'LD_LIBRARY', 'COLCON'))}


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_wheel_alone_inits_simulates_identifies_tunes_sweeps_and_reports(installed, tmp_path):
    def run(*words):
        done = subprocess.run(
            [installed / words[0], *map(str, words[1:])], cwd=tmp_path, env=without_paths(),
            capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    (tmp_path / 'plan.yaml').write_text(SHORT_PLAN)
    (tmp_path / 'sweep.yaml').write_text(SWEEP)
    where = run('python', '-c', 'import piezo_ros; print(piezo_ros.__file__)')
    assert where.startswith(str(installed.parent))
    assert not imported_for_help(installed / 'python', tmp_path, without_paths()) & {*HEAVY}
    run('piezo', 'init', 'demo', '-o', 'own')
    assert any((tmp_path / 'own').iterdir())
    run('piezo', 'simulate', 'plan.yaml', '-o', 'out')
    triangle, scan = sorted((tmp_path / 'out' / 'bags').iterdir())
    run('piezo', 'identify', 'hysteresis', triangle, '--elements', 4, '--every', 20,
        '--accept-poor', '-o', 'compensator.yaml')
    model = next((tmp_path / 'own').rglob('trajectory.yaml'))
    run('piezo', 'tune', model, '--no-operating-points', '-o', 'controller.yaml')
    run('piezo', 'sweep', 'sweep.yaml', '-o', 'swept')
    run('piezo', 'report', scan, '-o', 'report')
    for page in 'out', 'swept', 'report':
        assert (tmp_path / page / 'report.html').stat().st_size > 0
