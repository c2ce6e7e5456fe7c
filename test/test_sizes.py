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

"""No file, class or folder is too large to be read at once, and each file has a name of its own."""

import ast
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'piezo_ros'
FILE_LINES = 450
NODE_LINES = 200  # of a file of a node
NODE_FOLDERS = ('nodes', 'runtime/node')
CLASS_METHODS = 20  # properties count
FOLDER_MODULES = 14  # without __init__.py


def longest(path, package):
    """Return how many lines a file may have."""
    place = path.relative_to(package)
    is_of_node = any(place.is_relative_to(folder) for folder in NODE_FOLDERS)
    return NODE_LINES if is_of_node else FILE_LINES


def too_long(package):
    """Yield each file with too many lines, and their number."""
    for path in sorted(package.rglob('*.py')):
        lines = len(path.read_text(encoding='utf-8').splitlines())
        if lines > longest(path, package):
            yield f'{path.relative_to(package)}: {lines} lines'


def too_many_methods(package):
    """Yield each class with too many methods, and their number."""
    for path in sorted(package.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ClassDef):
                # A property and its setter have one name.
                methods = {
                    member.name for member in node.body
                    if isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef))}
                if len(methods) > CLASS_METHODS:
                    yield (
                        f'{path.relative_to(package)}: {node.name} has {len(methods)} methods')


def too_full(package):
    """Yield each folder with too many modules, and their number."""
    modules = Counter(
        path.parent for path in package.rglob('*.py') if path.name != '__init__.py')
    for folder, count in sorted(modules.items()):
        if count > FOLDER_MODULES:
            yield f'{folder.relative_to(package)}: {count} modules'


def named_alike(package):
    """Yield the files that have one name."""
    places = {}
    for path in sorted(package.rglob('*.py')):
        if not path.name.startswith('__'):
            places.setdefault(path.name, []).append(str(path.relative_to(package)))
    for paths in places.values():
        if len(paths) > 1:
            yield ' and '.join(paths)


@pytest.mark.parametrize('find', [too_long, too_many_methods, too_full, named_alike])
def test_nothing_is_too_large_or_named_alike(find):
    found = [*find(PACKAGE)]
    assert not found, '\n'.join(found)


def test_what_is_too_large_or_named_alike_would_be_found(tmp_path):
    methods = ''.join(f'    def method_{number}(self):\n        pass\n' for number in range(21))
    texts = {
        'long.py': '\n' * 451, 'short.py': '\n' * 450,
        'nodes/long_node.py': '\n' * 201, 'runtime/node/short_node.py': '\n' * 200,
        'classes.py': f'class Large:\n{methods}',
        **{f'full/full_{number}.py': '' for number in range(15)}, 'full/__init__.py': '',
        **{f'filled/filled_{number}.py': '' for number in range(13)}, 'filled/__init__.py': '',
        'filled/short.py': ''}
    for name, text in texts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    assert [*too_long(tmp_path)] == ['long.py: 451 lines', 'nodes/long_node.py: 201 lines']
    assert [*too_many_methods(tmp_path)] == ['classes.py: Large has 21 methods']
    assert [*too_full(tmp_path)] == ['full: 15 modules']
    assert [*named_alike(tmp_path)] == ['filled/short.py and short.py']
