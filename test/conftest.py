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

import importlib.util
import os
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

from piezo_ros.matrix_threads import use_one_thread

# Before any test module imports rclpy, matplotlib or NumPy; subprocesses inherit it. Stale
# shared-memory segments of killed processes would make endpoints match without data, hence UDP.
os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
os.environ['MPLBACKEND'] = 'Agg'
use_one_thread()

# Busy machines keep a process waiting for seconds: no examples are too slow for that.
settings.register_profile('patient', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('patient')

WITHOUT_ROS = importlib.util.find_spec('rclpy') is None
collect_ignore = [
    'contract', 'faults/test_final_ramp.py', 'faults/test_live_faults.py',
    'faults/test_live_messages.py', 'faults/test_message_mutations.py', 'live', 'nodes', 'runtime',
    'cli/test_run_live.py'] if WITHOUT_ROS else []

# In test/support: fixtures of tests that start processes, and of tests on a fake clock.
pytest_plugins = ['fake_clock', 'processes']

# Files of over half a minute, which workers begin with: none is left alone with one at the end.
LONG_FILES = (
    'test/cli/test_identify.py', 'test/test_lint.py', 'test/contract/test_contract.py',
    'test/live/test_live_campaign.py', 'test/live/test_failure.py', 'test/cli/test_tune.py',
    'test/identification/hysteresis/test_hysteresis_fit.py', 'test/live/test_kept_graph.py')


def pytest_configure(config):
    # Else workers begin with the files of most tests, and end with all that wait for processes.
    if hasattr(config.option, 'loadscopereorder'):
        config.option.loadscopereorder = False


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Mix files that wait for processes with files that compute, where several workers run."""
    if 'PYTEST_XDIST_WORKER' in os.environ:
        items.sort(key=_turn)


def _turn(item):
    file = item.nodeid.partition('::')[0]
    return LONG_FILES.index(file) if file in LONG_FILES else len(LONG_FILES) + crc32(file.encode())


def pytest_report_header():
    return f'no rclpy: left out are {", ".join(collect_ignore)}' if WITHOUT_ROS else None
