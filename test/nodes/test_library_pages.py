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

"""Memory that is given back: less is in use, and everything goes on working."""

import subprocess
import sys

PROGRAM = """
import numpy as np
from scipy.linalg import expm
from piezo_ros.nodes.library_pages import give_back_code

def file_kb():
    with open('/proc/self/status') as status:
        return next(int(line.split()[1]) for line in status if line.startswith('RssFile:'))

matrix = np.arange(16.0).reshape(4, 4) / 16.0
before, expected = file_kb(), expm(matrix)
assert give_back_code() > 0
after = file_kb()
assert np.array_equal(expm(matrix), expected)
import sqlite3, zipfile, lzma  # more code than was there before
assert sqlite3.connect(':memory:').execute('select 6 * 7').fetchone() == (42,)
assert give_back_code() > 0
print(before, after)
"""


def test_code_that_is_given_back_comes_again_when_it_is_needed():
    result = subprocess.run(
        [sys.executable, '-c', PROGRAM], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    before_kb, after_kb = map(int, result.stdout.split())
    assert after_kb < before_kb / 2
