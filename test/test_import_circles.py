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

"""No circle of files: no module imports, by way of others, itself."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'piezo_ros'


def module_name(path, package):
    """Return the name of the module that a file is; of an __init__.py that of its package."""
    parts = path.relative_to(package.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def packages_of(name):
    """Return the packages that a module lies in."""
    parts = name.split('.')
    return {'.'.join(parts[:count]) for count in range(1, len(parts))}


def imported_names(path, module):
    """
    Yield the modules that a file imports, in functions and for types only as well.

    ``from package import name`` yields ``package.name``, which may be a module or not.
    """
    is_package = path.name == '__init__.py'
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ''
            if node.level:
                parts = module.split('.')
                above = parts[:len(parts) - node.level + is_package]
                base = '.'.join([*above, *([base] if base else [])])
            for alias in node.names:
                yield f'{base}.{alias.name}'


def dependencies(package):
    """
    Return each module of a package with the modules that it depends on.

    To import ``a.b.c`` runs the __init__.py of a and of a.b too; they count, but not for a module
    that lies in the same package: there they have begun to run already.
    """
    files = {module_name(path, package): path for path in package.rglob('*.py')}
    found = {}
    for module, path in files.items():
        own = packages_of(module)
        found[module] = set()
        for name in imported_names(path, module):
            if name in files:
                target = name
            elif (target := name.rpartition('.')[0]) not in files:
                continue  # of another package
            found[module] |= {target} | (packages_of(target) & files.keys()) - own
        found[module].discard(module)
    return found


def circles(graph):
    """Return the strongly connected sets of several modules (Tarjan), each as a frozenset."""
    index, lowest, stack, found = {}, {}, [], []

    def visit(module):
        index[module] = lowest[module] = len(index)
        stack.append(module)
        for target in graph[module]:
            if target not in index:
                visit(target)
                lowest[module] = min(lowest[module], lowest[target])
            elif target in stack:
                lowest[module] = min(lowest[module], index[target])
        if lowest[module] == index[module]:
            at = stack.index(module)
            if len(stack) - at > 1:
                found.append(frozenset(stack[at:]))
            del stack[at:]

    for module in graph:
        if module not in index:
            visit(module)
    return found


def way_around(circle, graph):
    """Return a shortest way from a module of a circle back to it, as a text."""
    start = min(circle)
    ways = [[start]]
    seen = set()
    for way in ways:
        for target in sorted(graph[way[-1]] & circle):
            if target == start:
                return ' -> '.join([*way, start])
            if target not in seen:
                seen.add(target)
                ways.append([*way, target])
    raise AssertionError(f'{circle} is no circle')


def test_there_is_no_circle_of_files():
    graph = dependencies(PACKAGE)
    found = circles(graph)
    assert not found, '\n'.join(way_around(circle, graph) for circle in found)


SOURCES = {
    'plain': ({'a': 'from pack import b', 'b': 'import pack.a'}, 'pack.a -> pack.b -> pack.a'),
    'in a function': (
        {'a': 'def f():\n    from pack.b import x', 'b': 'from pack.a import y'},
        'pack.a -> pack.b -> pack.a'),
    'for types': (
        {'a': 'if TYPE_CHECKING:\n    from . import b', 'b': 'from .a import y'},
        'pack.a -> pack.b -> pack.a'),
    'by a package': (
        {'room/__init__': 'from pack.room.a import x', 'room/a': 'import pack.b',
         'b': 'import pack.room.c', 'room/c': ''},
        'pack.b -> pack.room -> pack.room.a -> pack.b'),
    'of three': (
        {'a': 'import pack.b', 'b': 'import pack.c', 'c': 'import pack.a', 'd': 'import pack.a'},
        'pack.a -> pack.b -> pack.c -> pack.a'),
    'none': ({'__init__': 'from pack.a import x', 'a': 'from pack import b', 'b': 'import os'}, ''),
}


@pytest.mark.parametrize('name', SOURCES)
def test_every_kind_of_import_is_seen(name, tmp_path):
    files, expected = SOURCES[name]
    package = tmp_path / 'pack'
    for module, text in {'__init__': '', **files}.items():
        path = package / f'{module}.py'
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    graph = dependencies(package)
    assert '; '.join(way_around(circle, graph) for circle in circles(graph)) == expected
