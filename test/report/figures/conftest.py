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

import xml.etree.ElementTree as ElementTree

import pytest

from piezo_ros.report.figures.export import svg
from piezo_ros.report.page.inline_svg import inline_svg


@pytest.fixture
def words():
    """Return a function that returns all text of a figure."""
    return lambda figure: ' '.join(ElementTree.fromstring(svg(figure, 'a')).itertext())


@pytest.fixture
def assert_reproducible():
    """Return a function that asserts that drawing twice gives the same self-contained SVG."""
    def check(draw):
        first, second = (svg(draw(), 'a') for _ in range(2))
        assert first == second
        assert 'dc:date' not in first
        ElementTree.fromstring(first)
        assert 'http' not in inline_svg(first, 'what it shows')
    return check
