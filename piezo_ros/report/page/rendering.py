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

"""Renders the Jinja templates of the page."""

from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

__all__ = ['render']

_ENVIRONMENT: Final = Environment(
    loader=PackageLoader('piezo_ros.report.page', 'templates'),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def render(template: str, **values: Any) -> Markup:
    """
    Render a template of this package.

    Parameters
    ----------
    template : str
        Name of the template without ``.html.jinja``.
    **values
        Its variables. Each is escaped unless it is `Markup`, that is, HTML itself.

    Returns
    -------
    Markup
        The HTML.

    Raises
    ------
    jinja2.UndefinedError
        If the template uses a variable that is not given.

    """
    return Markup(_ENVIRONMENT.get_template(f'{template}.html.jinja').render(values))
