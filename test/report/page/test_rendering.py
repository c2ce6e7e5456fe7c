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

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from piezo_ros.report.page.rendering import render


def test_text_is_escaped_and_html_is_not():
    assert render('paragraph', text='a < b') == '<p>a &lt; b</p>\n'
    assert render('paragraph', text=Markup('<em>a</em>')) == '<p><em>a</em></p>\n'


def test_a_variable_that_is_not_given_is_an_error():
    with pytest.raises(UndefinedError, match="'text' is undefined"):
        render('paragraph')
