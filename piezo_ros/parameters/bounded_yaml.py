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
YAML from any source, read within bounds.

The events of a text are counted before anything is built of them, so that neither deep nesting nor
aliases of aliases can exhaust the stack or the memory.
"""

import re
from collections.abc import Iterator
from typing import Any, Final

import yaml

from piezo_ros.parameters.file_lines import LinedMapping

__all__ = ['MAXIMUM_BYTES', 'YamlError', 'yaml_content']

MAXIMUM_BYTES: Final = 16 << 20
_MAXIMUM_DEPTH: Final = 64
_MAXIMUM_ALIASED: Final = 1_000_000  # characters and values that aliases repeat, in total
# An int of several hundred digits, or one of base 60, takes a time that grows with its square.
_ENDLESS_NUMBER: Final = re.compile(r'[-+0-9_.:]{400,}')
_TAG: Final = 'tag:yaml.org,2002:'
# Octal and base 60 for YAML 1.1 alone: 010 is 8 there, and 1:30 is 90.
_OTHER_THAN_TYPED: Final = re.compile(r'[-+]?0[0-7_]+|[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?')
_NO_TOKEN: Final = (
    '; lines are indented with blanks, no tabs, and a text that begins with %, @ or ` is quoted')


class YamlError(ValueError):
    """A text that is no YAML, or exceeds the bounds; the text of the error says why."""


# The compiled one is ten times quicker, where it is installed.
class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """Reads numbers as the parameter files of ROS do: 1e-5, 1.0e9 and .5e3 are some."""


# YAML 1.1 wants a point in the mantissa and a sign in the exponent.
_Loader.add_implicit_resolver(
    f'{_TAG}float', re.compile(r'[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$'),
    list('-+.0123456789'))


class _LinedLoader(_Loader):
    """Makes mappings that know the lines of their keys."""

    def lined_mapping(self, node: yaml.MappingNode) -> Iterator[LinedMapping]:
        """Yield a mapping before what is in it, which may lie in itself."""
        mapping = LinedMapping()
        yield mapping
        mapping.update(self.construct_mapping(node))
        mapping.lines.update(
            (key.value, key.start_mark.line + 1) for key, _ in node.value
            if isinstance(key, yaml.ScalarNode))


_LinedLoader.add_constructor(f'{_TAG}map', _LinedLoader.lined_mapping)


def yaml_content(text: str | bytes, *, as_typed: bool = False) -> Any:
    """
    Return the content of a YAML text.

    Parameters
    ----------
    text : str or bytes
        One document, bytes in UTF-8.
    as_typed : bool, optional
        For what people write: refuse a mapping that has a key twice, of which the last would win
        without a word; take every key, and a number in octal or base 60 such as 010 or 1:30, as
        the text that it is; and return mappings that know the lines of their keys
        (`LinedMapping`).

    Returns
    -------
    value
        Mappings, lists, strings, numbers, dates; None for an empty text.

    Raises
    ------
    YamlError
        If it is no YAML, larger than `MAXIMUM_BYTES`, nested deeper than 64 levels, repeated by
        aliases more than a million times, has an alias for what it lies in, or a key twice.

    """
    if len(text) > MAXIMUM_BYTES:
        raise YamlError(f'{len(text)} bytes of YAML, at most {MAXIMUM_BYTES} are read')
    try:
        text = _decoded(text)
        _check_events(text)
        loader = (_LinedLoader if as_typed else _Loader)(text)  # of the safe kind
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            if as_typed:
                _keep_as_typed(node)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except YamlError:
        raise
    except yaml.MarkedYAMLError as error:
        raise YamlError(_place_text(error)) from None
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError) as error:
        # ValueError: a date that does not exist, a number beyond all bounds.
        raise YamlError(' '.join(str(error).split())) from None


def _decoded(text: str | bytes) -> str:
    """Return the text of bytes; a mark of the byte order ahead of UTF-8 is left out."""
    if isinstance(text, str):
        return text
    if b'\0' in text:
        raise YamlError('it is in UTF-16 or is no text at all, save it as UTF-8')
    try:
        return text.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = text.count(b'\n', 0, error.start) + 1
        raise YamlError(
            f'line {line}: the byte 0x{text[error.start]:02x} is no UTF-8, save it as UTF-8'
        ) from None


def _place_text(error: yaml.MarkedYAMLError) -> str:
    """Return one line: what is wrong, and where."""
    words = ', '.join(filter(None, (error.problem, error.context)))
    if 'cannot start any token' in words:  # nor does the parser say which character it is
        words += _NO_TOKEN
    mark = error.problem_mark or error.context_mark
    return f'line {mark.line + 1}, column {mark.column + 1}: {words}' if mark else words


def _keep_as_typed(root: yaml.Node) -> None:
    """Refuse a key that comes twice in one mapping; let keys, and some numbers, be text."""
    unchecked, checked = [root], set()
    while unchecked:
        node = unchecked.pop()
        if id(node) in checked:  # aliases
            continue
        checked.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            unchecked += node.value
        elif isinstance(node, yaml.MappingNode):
            _check_keys(node)
            unchecked += [each for pair in node.value for each in pair]
        elif node.tag in (f'{_TAG}int', f'{_TAG}float') and _OTHER_THAN_TYPED.fullmatch(node.value):
            node.tag = f'{_TAG}str'


def _check_keys(mapping: yaml.MappingNode) -> None:
    """Let the keys be text; of one that comes twice, both lines are named."""
    lines: dict[str, int] = {}
    for key, _ in mapping.value:
        if not isinstance(key, yaml.ScalarNode):
            continue
        line = key.start_mark.line + 1
        if key.value in lines:
            raise YamlError(
                f'the key {key.value!r} is in line {lines[key.value]} and in line {line}')
        lines[key.value] = line
        if key.tag != f'{_TAG}merge':
            key.tag = f'{_TAG}str'


def _check_events(text: str) -> None:
    """Refuse a text of which the content would exceed the bounds."""
    sizes: dict[str, int] = {}  # of what has an anchor, with all that is in it
    open_nodes: list[tuple[str | None, int]] = [(None, 0)]
    aliased = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise YamlError(f'the alias *{event.anchor} is for nothing or for what it lies in')
            size = sizes[event.anchor]
            aliased += size
            if aliased > _MAXIMUM_ALIASED:
                raise YamlError(f'aliases repeat more than {_MAXIMUM_ALIASED} characters')
        elif isinstance(event, yaml.ScalarEvent):
            if event.implicit[0] and _ENDLESS_NUMBER.fullmatch(event.value):
                raise YamlError(f'a number of {len(event.value)} characters')
            size = 1 + len(event.value)
            if event.anchor is not None:
                sizes[event.anchor] = size
        elif isinstance(event, yaml.CollectionStartEvent):
            if len(open_nodes) > _MAXIMUM_DEPTH:
                raise YamlError(f'nested deeper than {_MAXIMUM_DEPTH} levels')
            sizes.pop(event.anchor or '', None)  # the name may be taken again
            open_nodes.append((event.anchor, 1))
            continue
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, size = open_nodes.pop()
            if anchor is not None:
                sizes[anchor] = size
        else:
            continue
        anchor, inside = open_nodes[-1]
        open_nodes[-1] = anchor, inside + size
