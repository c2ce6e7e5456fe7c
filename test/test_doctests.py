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

"""The examples in the docstrings give what they print."""

import doctest
import importlib
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'piezo_ros'
NEED_ROS = {'cli', 'nodes'}
SOURCES = sorted(
    path for path in PACKAGE.rglob('*.py')
    if path.relative_to(PACKAGE).parts[0] not in NEED_ROS
    and '>>>' in path.read_text(encoding='utf-8'))


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


@pytest.mark.parametrize('path', SOURCES, ids=module_name)
def test_the_examples_of_a_module_give_what_they_print(path):
    results = doctest.testmod(importlib.import_module(module_name(path)))
    assert results.failed == 0
    # doctest passes over what a decorator hides, such as lru_cache.
    written = doctest.DocTestParser().get_examples(path.read_text(encoding='utf-8'))
    assert results.attempted == len(written)
