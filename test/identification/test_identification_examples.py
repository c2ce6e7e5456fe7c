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

"""The examples in the docstrings of the identification are run and must give what they say."""

import doctest
import importlib
import pkgutil

import pytest

import piezo_ros.identification

MODULES = [
    module.name for module in pkgutil.walk_packages(
        piezo_ros.identification.__path__, f'{piezo_ros.identification.__name__}.')
    if not module.ispkg]


@pytest.mark.parametrize('name', MODULES)
def test_the_examples_in_the_docstrings_give_what_they_say(name):
    results = doctest.testmod(importlib.import_module(name))
    assert results.failed == 0


def test_there_are_examples_in_every_room():
    rooms = {
        name.split('.')[2] for name in MODULES
        if any(test.examples for test in doctest.DocTestFinder().find(
            importlib.import_module(name)))}
    assert rooms >= {'hysteresis', 'response', 'tuning', 'prediction'}
