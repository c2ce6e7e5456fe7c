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

"""
One thread for the matrix library of NumPy and SciPy, unless the user wants more.

The matrices here are small: on an idle machine a second thread makes a fit no quicker. On a busy
machine the threads wait for each other, and a fit takes many times as long.
"""

import os
from typing import Final

__all__ = ['ONE_THREAD', 'use_one_thread']

ONE_THREAD: Final = dict.fromkeys(
    ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')


def use_one_thread() -> None:
    """Say so in the environment; to be called before NumPy is imported, which reads it then."""
    for variable, threads in ONE_THREAD.items():
        os.environ.setdefault(variable, threads)
