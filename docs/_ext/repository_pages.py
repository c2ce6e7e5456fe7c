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
Pages of the site that are files above docs/, and links between these files and the pages.

On GitHub README.md links to docs/topics.md; in the site both are pages of one tree. A link to a
file of the repository that is no page keeps its text alone.
"""

import os
import re
from pathlib import Path, PurePosixPath

# Page of the site -> file of the repository with its text.
REPOSITORY_PAGES = {
    'project/readme': 'README.md',
    'project/benchmarks': 'benchmarks/README.md',
    'project/changelog': 'CHANGELOG.rst',
    'project/contributing': 'CONTRIBUTING.md',
    'project/quality-declaration': 'QUALITY_DECLARATION.md',
}
_PAGE_OF_FILE = {file: page for page, file in REPOSITORY_PAGES.items()}
_CODE_OR_LINK = re.compile(
    r'^```.*?^```$|^    .*?$|`[^`\n]*`'
    r'|(?P<mark>!?)\[(?P<text>[^\[\]]*)\]\(\s*(?P<target>[^()\s]+)\s*\)', re.MULTILINE | re.DOTALL)


def with_links_of_site(text: str, file: str, page: str, repository: Path) -> str:
    """
    Return a Markdown text with its relative links as they are from a page of the site.

    Parameters
    ----------
    text : str
        The Markdown.
    file : str
        The file that it is from, relative to the repository.
    page : str
        The page that it is on, relative to docs/, without suffix.
    repository : Path
        The folder of README.md.

    """
    def changed(found: re.Match[str]) -> str:
        target = found['target']
        if target is None or re.match(r'[a-z]+:|#', target):
            return found[0]
        path, _, anchor = target.partition('#')
        named = os.path.normpath(PurePosixPath(file).parent / path)
        if named in _PAGE_OF_FILE:
            suffix = PurePosixPath(named).suffix
            of_site = _PAGE_OF_FILE[named] + suffix
        elif named.startswith('docs/') and (repository / named).is_file():
            of_site = named.removeprefix('docs/')
        else:
            return found['text']
        link = os.path.relpath(of_site, PurePosixPath(page).parent)
        return f'{found["mark"]}[{found["text"]}]({link}{"#" * bool(anchor)}{anchor})'

    return _CODE_OR_LINK.sub(changed, text)


def replace_source(app, docname, source):
    """Put the file of the repository in the place of its page, and the links of the site in all."""
    repository = Path(app.config.repository)
    file = REPOSITORY_PAGES.get(docname)
    if file:
        source[0] = (repository / file).read_text(encoding='utf-8')
    name = file or 'docs/' + Path(app.env.doc2path(docname)).relative_to(app.srcdir).as_posix()
    if name.endswith('.md'):
        source[0] = with_links_of_site(source[0], name, docname, repository)


def setup(app):
    """Connect to Sphinx."""
    app.add_config_value('repository', '', 'env')
    app.connect('source-read', replace_source)
    return {'parallel_read_safe': True}
