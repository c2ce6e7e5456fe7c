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

"""Identification, simulation and reports on a laptop that has never seen ROS."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from python_path import python_path

REPOSITORY = Path(__file__).resolve().parents[2]
WITHOUT_ROS = """\
import importlib, pkgutil, sys

class NoRos:
    ROS = {'rclpy', 'std_msgs', 'std_srvs', 'rcl_interfaces', 'lifecycle_msgs', 'rosgraph_msgs',
           'diagnostic_msgs', 'sensor_msgs', 'launch', 'launch_ros', 'ament_index_python'}

    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in self.ROS:
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, NoRos())
"""
IMPORT_EVERYTHING = """\
import piezo_ros
WITH_ROS = tuple(f'piezo_ros.{room}.' for room in ('contract', 'live', 'nodes', 'runtime'))
for module in pkgutil.walk_packages(piezo_ros.__path__, 'piezo_ros.'):
    if module.name.startswith(WITH_ROS) or module.name.endswith('__main__'):
        continue
    importlib.import_module(module.name)
    print(module.name)
"""
COMMAND = 'from piezo_ros.cli.main import main; sys.exit(main())'


@pytest.fixture
def python(tmp_path):
    def run(program, *arguments):
        return subprocess.run(
            [sys.executable, '-c', WITHOUT_ROS + program, *map(str, arguments)], cwd=tmp_path,
            env={**os.environ, 'PYTHONPATH': python_path(REPOSITORY)}, check=False,
            capture_output=True, text=True)
    return run


def test_the_blocker_blocks(python):
    assert 'No module named' in python('import rclpy').stderr
    assert 'No module named' in python('from std_msgs.msg import String').stderr


def test_everything_below_the_nodes_and_the_command_line_imports(python):
    done = python(IMPORT_EVERYTHING)
    assert done.returncode == 0, done.stderr
    imported = done.stdout.split()
    for tier in ('paper', 'model.model_kernels', 'control.loop_kernels', 'bag.salvage',
                 'report.page.page_writer', 'experiment.offline', 'identification', 'cli.main',
                 'cli.run'):
        assert f'piezo_ros.{tier}' in imported


def test_a_plan_is_simulated(python, plan, tmp_path):
    done = python(COMMAND, 'simulate', plan, '-o', tmp_path / 'out')
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())
    assert len(report['runs']) == 2


def test_a_live_run_says_what_it_needs(python, plan, tmp_path):
    done = python(COMMAND, 'run', plan, '-o', tmp_path / 'out')
    assert done.returncode == 1
    assert 'piezo run needs ROS 2' in done.stderr
    assert 'piezo simulate does without it' in done.stderr
    assert 'Traceback' not in done.stderr
