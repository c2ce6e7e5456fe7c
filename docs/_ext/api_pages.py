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
API pages: one for each module, and one for each name that a package offers.

The sources are parsed, not imported: what there is to document does not depend on what is
installed. Sphinx imports the modules where it reads the pages.
"""

import ast
import builtins
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

FOLDER = Path('generated', 'api')
NAMES = 'names'  # a folder of its own, beside those of the modules


class Module(NamedTuple):
    """
    What the source of a module says of it.

    Attributes
    ----------
    name : str
        With the names of its packages.
    is_package : bool
        Whether it is a folder of modules.
    public : tuple of str
        Its ``__all__``; empty where there is none.
    imported : mapping of str to str
        Name that it imports -> module that it imports it from.
    assigned : mapping of str to ast.expr
        Name that it assigns to -> the expression: constants and types.

    """

    name: str
    is_package: bool
    public: tuple[str, ...]
    imported: Mapping[str, str]
    assigned: Mapping[str, ast.expr | None]

    @property
    def own(self) -> tuple[str, ...]:
        """The public names that are documented on its page, or on pages of their own."""
        if not self.is_package:
            return tuple(name for name in self.public if name not in self.imported)
        # What a package offers of its own modules; another package documents its own.
        # A function that has the name of its module is documented there.
        return tuple(
            name for name in self.public
            if self.imported.get(name, self.name + '.').startswith(self.name + '.')
            and self.imported.get(name) != f'{self.name}.{name}')


def public_names(tree: ast.Module) -> tuple[str, ...]:
    """Return ``__all__`` of a parsed module."""
    for statement in tree.body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == '__all__':
            return tuple(ast.literal_eval(statement.value))
    return ()


def modules_of(package: Path) -> Iterator[Module]:
    """Yield every module of a package and of the packages in it, a package before its modules."""
    for path in sorted(package.rglob('*.py'), key=lambda path: path.with_suffix('').parts):
        parts = path.relative_to(package.parent).with_suffix('').parts
        if parts[-1] == '__main__':  # runs as it is imported
            continue
        is_package = parts[-1] == '__init__'
        tree = ast.parse(path.read_text(encoding='utf-8'))
        imported = {
            alias.asname or alias.name: statement.module for statement in tree.body
            if isinstance(statement, ast.ImportFrom) and statement.module
            for alias in statement.names}
        name = '.'.join(parts[:-1] if is_package else parts)
        yield Module(
            name, is_package, public_names(tree), imported, dict(assignments(tree)))


def assignments(tree: ast.Module) -> Iterator[tuple[str, ast.expr | None]]:
    """Yield the names that a module assigns to, also several at once, with the expression."""
    for statement in tree.body:
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            for target in getattr(statement, 'targets', [getattr(statement, 'target', None)]):
                for node in ast.walk(target):
                    if isinstance(node, ast.Name):
                        yield node.id, statement.value


def entry_of(module: str, name: str, value: ast.expr | None) -> list[str]:
    """
    Return the lines that document what a module assigns to a name.

    numpydoc fails at the signature that a type like ``dict[str, int]`` and a bound method of a type
    written in C inherit: these are told as they stand in the source.
    """
    base = value.value if isinstance(value, ast.Subscript) else None
    is_type = isinstance(base, ast.Name) and hasattr(builtins, base.id)
    if is_type or isinstance(value, ast.Attribute):
        return [
            f'.. py:data:: {name}', f'   :module: {module}', '',
            f'   ``{ast.unparse(value)}``', '']
    return [f'.. autodata:: {module}.{name}']


def page_of(module: Module, inner: list[str]) -> str:
    """
    Return the page of a module as reStructuredText.

    Parameters
    ----------
    module : Module
        The module.
    inner : list of str
        Full names of the modules in it.

    """
    lines = [module.name, '=' * len(module.name), '', f'.. automodule:: {module.name}']
    others = [name for name in module.public if name not in module.own]
    if not module.is_package and module.public:
        # Of what a module assigns automodule shows what has a comment of its own alone.
        constants = [name for name in module.own if name in module.assigned]
        lines += [
            '   :members:', '   :undoc-members:',
            f'   :exclude-members: {", ".join([*others, *constants])}', '',
            *(line for name in constants
              for line in entry_of(module.name, name, module.assigned[name]))]
    elif module.own:
        lines += [
            '', '.. rubric:: Public names', '', '.. autosummary::', f'   :toctree: {NAMES}', '',
            *(f'   {name}' for name in module.own)]
    if others:
        lines += [
            '', '.. rubric:: Names of other modules', '',
            *(f'* :py:obj:`{name} <{module.imported[name]}.{name}>`' for name in others)]
    if inner:
        lines += [
            '', '.. rubric:: Modules', '', '.. toctree::', '   :maxdepth: 1', '',
            *(f'   {name}' for name in inner)]
    return '\n'.join([*lines, ''])


def write_pages(app, config):
    """Write the page of every module, and remove those of modules that are gone."""
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    package, *modules = modules_of(Path(config.repository) / 'piezo_ros')
    assert not package.public, 'docs/api.rst stands for the page of the package'
    written = set()
    for module in modules:
        inner = [other.name for other in modules if other.name.rpartition('.')[0] == module.name]
        path = folder / f'{module.name}.rst'
        text = page_of(module, inner)
        if not path.exists() or path.read_text(encoding='utf-8') != text:
            path.write_text(text, encoding='utf-8')
        written |= {path, *(
            folder / NAMES / f'{module.name}.{name}.rst'
            for name in module.own if module.is_package)}
    # What autosummary wrote of a name stays as long as the name does.
    for path in {*folder.rglob('*.rst')} - written:
        path.unlink()


def setup(app):
    """Write the pages before Sphinx looks for its documents."""
    app.connect('config-inited', write_pages)
    return {'parallel_read_safe': True}
