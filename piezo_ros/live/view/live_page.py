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

"""The HTML of the live page: one document with its style, its script and the plotting library."""

from importlib.resources import files
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from piezo_ros.report.page.chart import chart_library

__all__ = ['live_page']

_TEMPLATES: Final = 'templates'


def live_page(nonce: str) -> str:
    """
    Return the page, without any data; its script fetches them from beside the page.

    Parameters
    ----------
    nonce : str
        What the elements of style and script bear, so that the browser takes no others.

    """
    environment = Environment(
        loader=PackageLoader('piezo_ros.live.view', _TEMPLATES), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    library = chart_library()
    return environment.get_template('live.html.jinja').render(
        nonce=nonce,
        base_style=_text('piezo_ros.report.page', 'report.css'),
        style=_text('piezo_ros.live.view', 'live.css'),
        script=_text('piezo_ros.live.view', 'live.js'),
        chart_style=_with_nonce(library.style, 'style', nonce),
        chart_script=_with_nonce(library.script, 'script', nonce))


def _text(package: str, name: str) -> Markup:
    return Markup(files(package).joinpath(_TEMPLATES, name).read_text(encoding='utf-8'))


def _with_nonce(elements: Markup, tag: str, nonce: str) -> Markup:
    return Markup(str(elements).replace(f'<{tag}>', f'<{tag} nonce="{nonce}">'))
