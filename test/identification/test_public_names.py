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

"""The names that ``piezo_ros.identification`` offers, and what importing it costs."""

import subprocess
import sys

import pytest

from piezo_ros import identification

HEAVY = {'control', 'matplotlib', 'numba', 'scipy.optimize', 'scipy.signal', 'scipy.stats'}


def test_every_name_is_there():
    for name in identification.__all__:
        assert getattr(identification, name).__module__.startswith('piezo_ros.identification.')
    assert {*identification.__all__} <= {*dir(identification)}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match='identification. has no attribute .fit_everything'):
        _ = identification.fit_everything


@pytest.mark.parametrize('module', [
    'piezo_ros.identification', 'piezo_ros.identification.prediction.accuracy'])
def test_what_is_not_used_is_not_imported(module):
    code = f'import sys, {module}; print(*sys.modules)'
    told = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout
    assert module in told.split()
    assert not HEAVY & {*told.split()}
