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
Damage to bags as data: each kind of it is a function of a random generator and a bag.

A bag is a dict of file name to content, bytes; `Special` stands for what is no regular file. A
mutation changes the dict. All of them are in `MUTATIONS`, by name.
"""

import enum
from functools import partial

import yaml
from mcap_mutations import BYTES, CHUNKS, MESSAGES, RECORDS, of_a_chunk

__all__ = ['MUTATIONS', 'Special']


class Special(enum.Enum):
    """What stands in the place of a file."""

    PIPE = enum.auto()
    DIRECTORY = enum.auto()
    LOOP = enum.auto()


def _any_file(generator, bag):
    """Return the name of an MCAP file."""
    return generator.choice(sorted(name for name in bag if name.endswith('.mcap')))


_METADATA = 'metadata.yaml'
_ANYTHING = (
    None, True, 0, 5, -1, 2**63, 2**70, 1.5, float('nan'), '', 'zstd', '../..', [], [5], [[]], {},
    {'a': 1}, {5: []}, 'a' * 10_000)


def _nodes(content, path=()):
    """Yield the path of each entry of nested dicts and lists."""
    entries = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in entries:
        yield *path, key
        if isinstance(value, (dict, list)):
            yield from _nodes(value, (*path, key))


def _parent(content, path):
    for key in path[:-1]:
        content = content[key]
    return content


def _edit_metadata(edit, generator, bag):
    content = yaml.safe_load(bag[_METADATA])
    path = generator.choice([*_nodes(content)])
    edit(generator, _parent(content, path), path[-1])
    bag[_METADATA] = yaml.safe_dump(content).encode()


def _delete_key(generator, entries, key):
    del entries[key]


def _other_value(generator, entries, key):
    entries[key] = generator.choice(_ANYTHING)


def _other_count(generator, bag):
    content = yaml.safe_load(bag[_METADATA])
    information = content['rosbag2_bagfile_information']
    entry = generator.choice(information['topics_with_message_count'])
    entry['message_count'] = generator.choice([0, 1, -1, 10**9, entry['message_count'] + 1])
    bag[_METADATA] = yaml.safe_dump(content).encode()


def _hostile_yaml(generator, bag):
    bag[_METADATA] = generator.choice([
        b'[' * 20_000, b'&a [*a]', b'&a {a: *a}', b'{' * 20_000, b'!!python/object:a.b {}',
        b'a: &a [x]\n' + b''.join(
            b'a%d: &a%d [%s]\n' % (level, level, b', '.join([b'*a' + b'%d' % (level - 1)] * 9))
            for level in range(1, 12)),
        b'? [a, b]\n: c', b'\xef\xbb\xbf' + bag[_METADATA],
        bag[_METADATA].decode().encode('utf-16'),
        b'---\n' + bag[_METADATA] + b'---\n' + bag[_METADATA], b'\t- a', b'%YAML 9.9\n---\na: 1',
        b'9' * 5000, b'1:' * 5000, b'x' * 3_000_000, b'\0', b'a: b: c'])


def _other_paths(generator, bag):
    content = yaml.safe_load(bag[_METADATA])
    information = content['rosbag2_bagfile_information']
    paths = information['relative_file_paths']
    information['relative_file_paths'] = generator.choice([
        [], [*paths, 'there_is_none.mcap'], paths * 2, paths[::-1], ['/dev/zero'], ['..'], ['.'],
        ['../' + name for name in paths], ['a\0b'], ['a' * 300 + '.mcap'], [_METADATA],
        [f'./{name}' for name in paths], paths[:-1]])
    bag[_METADATA] = yaml.safe_dump(content).encode()


def _without_metadata(generator, bag):
    del bag[_METADATA]


def _without_file(generator, bag):
    del bag[_any_file(generator, bag)]


def _special_file(generator, bag):
    bag[generator.choice(sorted(bag))] = generator.choice([*Special])


def _extra_file(generator, bag):
    bag[generator.choice(['a.mcap', 'z_9.mcap', 'README', 'metadata.yml'])] = generator.choice([
        b'', b'text', bag[_any_file(generator, bag)], Special.PIPE, Special.DIRECTORY])


def _extra_file_without_metadata(generator, bag):
    _extra_file(generator, bag)
    _without_metadata(generator, bag)


def _swapped_files(generator, bag):
    names = sorted(name for name in bag if name.endswith('.mcap'))
    first, last = names[0], names[-1]
    bag[first], bag[last] = bag[last], bag[first]


def _nothing(generator, bag):
    bag.clear()


DIRECTORIES = {
    'no metadata.yaml': _without_metadata, 'no MCAP file': _without_file,
    'special file': _special_file, 'extra file': _extra_file,
    'extra file and no metadata.yaml': _extra_file_without_metadata,
    'files swapped': _swapped_files, 'empty directory': _nothing,
    'metadata.yaml: key deleted': partial(_edit_metadata, _delete_key),
    'metadata.yaml: other value': partial(_edit_metadata, _other_value),
    'metadata.yaml: other count': _other_count, 'metadata.yaml: hostile': _hostile_yaml,
    'metadata.yaml: other paths': _other_paths,
}


def _of_a_file(change, generator, bag):
    name = _any_file(generator, bag)
    bag[name] = change(generator, bag[name])


def _of_metadata(change, generator, bag):
    bag[_METADATA] = change(generator, bag[_METADATA])


MUTATIONS = {
    **{name: partial(_of_a_file, change) for name, change in BYTES.items()},
    **{f'{name}: {kind.name.lower()}': partial(_of_a_file, partial(change, kind=kind))
       for name, (change, kinds) in RECORDS.items() for kind in kinds},
    **{name: partial(_of_a_file, of_a_chunk(change))
       for name, change in {**CHUNKS, **MESSAGES}.items()},
    **{f'metadata.yaml: {name}': partial(_of_metadata, change) for name, change in BYTES.items()},
    **DIRECTORIES,
}
