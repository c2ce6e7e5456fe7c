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
Every option of every command, by what people type in place of a value.

The options are those of the parsers, so that one that is added is tested. Whatever is typed, the
parser either takes a value that is allowed, or exits with 2 and names the option and the value.
"""

import argparse
import math
from functools import cache
from pathlib import Path

import pytest

from piezo_ros.cli.shared.command_line import COMMANDS, argument_parser
from piezo_ros.cli.shared.option_types import Number, NumberOrWord, Whole

TYPED = (
    '', ' ', 'text', 'nan', '-nan', 'inf', '-inf', '0', '-1', '-1e-3', '1e308', '1e-320', '0x10',
    '1,5', '1e3', '1_000', '٣', '--', '=', '1.5 V', '9' * 5000, 'no_such_file', '.', 'a\nb')
# What may be no more than a text: names, and addresses that are '' where none is given.
TEXTS = {
    'piezo init name', 'piezo run --namespace', 'piezo check what', 'piezo check --namespace',
    'piezo check --start', 'piezo sweep --scheduler', 'piezo device list --address',
    'piezo image --namespaces', 'piezo report --scheme', 'piezo report --waveform',
    'piezo bag import --columns', 'piezo bag import --scale', 'piezo bag import --zero',
    *(f'piezo {command} --namespace' for command in (
        'identify hysteresis', 'identify creep', 'identify dynamics', 'identify uncertainty',
        'replay', 'report', 'bag info', 'bag export', 'bag motion')),
}


def parsers_below(parser):
    """Yield the parsers that have no subcommands."""
    inner = [
        action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not inner:
        yield parser
    for action in inner:
        for each in action.choices.values():
            yield from parsers_below(each)


def of_command(command):
    whole = parser_of(command)
    (commands,) = (
        action for action in whole._actions if isinstance(action, argparse._SubParsersAction))
    return [*parsers_below(commands.choices[command])]


def actions_with_value():
    return [
        pytest.param(parser.prog, action.dest, id=f'{parser.prog} {name(action)}')
        for command in COMMANDS for parser in of_command(command)
        for action in parser._actions if action.nargs != 0]


def name(action):
    return action.option_strings[-1] if action.option_strings else action.dest


def usable(action):
    """Return words that an argument takes."""
    if isinstance(action.type, Number | Whole):
        value = f'{action.type.most:.17g}'
    elif isinstance(action.type, NumberOrWord):
        value = action.type.word
    elif action.type is not None and 'plan' in action.dest:
        value = 'demo'
    else:
        value = action.choices[0] if action.choices else 'something'
    return [value] * (action.nargs if isinstance(action.nargs, int) else 1)


def words_around(parser, tested):
    """Return what else the command needs, its positional arguments last."""
    needed = []
    for action in sorted(parser._actions, key=lambda each: not each.option_strings):
        if tested.dest == 'fast' and action.dest == 'slow':
            continue
        if action is tested or not (action.required or not action.option_strings):
            continue
        if any(action in group._group_actions and tested in group._group_actions
               for group in parser._mutually_exclusive_groups):
            continue
        needed += [*action.option_strings[-1:], *usable(action)]
    return needed


def parse(prog, words):
    command = prog.split()[1:]
    return parser_of(command[0]).parse_args([*command, *words])


@cache
def parser_of(command):
    return argument_parser([command])


def answer(capsys, prog, words):
    """Return what was parsed and '', or None and the error, of which the exit code is 2."""
    code, parsed = 0, None
    try:
        parsed = parse(prog, words)
    except SystemExit as ended:
        code = ended.code
    told = capsys.readouterr().err.partition(f'{prog}: error: ')[2]
    assert code == (2 if told else 0), words
    return parsed, told


def found(prog, dest):
    parser = next(each for each in of_command(prog.split()[1]) if each.prog == prog)
    return parser, next(action for action in parser._actions if action.dest == dest)


def typed_words(action, text):
    """Return an argument with a text in the place of its first value."""
    values = [text, *usable(action)[1:]]
    return [*action.option_strings[-1:], *values]


def test_every_number_has_a_range():
    for command in COMMANDS:
        for parser in of_command(command):
            for action in parser._actions:
                assert action.type not in (int, float), f'{parser.prog} {name(action)}'


def test_every_text_is_one_that_may_be_anything():
    texts = {
        f'{parser.prog} {name(action)}' for command in COMMANDS for parser in of_command(command)
        for action in parser._actions
        if action.nargs != 0 and action.type in (None, str) and not action.choices}
    assert texts == TEXTS


@pytest.mark.parametrize(('prog', 'dest'), actions_with_value())
def test_what_is_typed_is_allowed_or_refused_by_name(capsys, prog, dest):
    parser, action = found(prog, dest)
    for text in TYPED:
        if text == '--' and (not action.option_strings or action.nargs == argparse.REMAINDER):
            continue  # what follows are no options
        words = [*words_around(parser, action), *typed_words(action, text)]
        parsed, told = answer(capsys, prog, words)
        if not told:
            check_allowed(action, getattr(parsed, dest), text)
            continue
        assert name(action) in told or str(action.metavar) in told or dest in told, text
        if 'expected' not in told:
            assert repr(text) in told or text in told, (text, told)


def check_allowed(action, parsed, text):
    """Check that what came through is a value of the type of an argument."""
    values = parsed if isinstance(parsed, list) else [parsed]
    if isinstance(action.type, Number | Whole):
        for value in values:
            assert math.isfinite(value), text
            assert action.type.least <= value <= action.type.most, text
    elif isinstance(action.type, NumberOrWord):
        assert values[0] == action.type.word or int(values[0]) <= action.type.number.most, text
    elif action.type is Path:
        assert text, 'an empty path is the working directory'
    elif action.type is None:
        assert text
        assert values[0] == text
    if action.choices:
        assert values[0] in action.choices


@pytest.mark.parametrize(('prog', 'dest'), actions_with_value())
def test_an_option_without_its_value_is_refused(capsys, prog, dest):
    parser, action = found(prog, dest)
    if not action.option_strings or action.nargs == argparse.REMAINDER:
        return
    with pytest.raises(SystemExit, match='^2$'):
        parse(prog, [*words_around(parser, action), action.option_strings[-1]])
    told = capsys.readouterr().err.splitlines()[-1]
    assert name(action) in told
    assert 'expected' in told


@pytest.mark.parametrize(('prog', 'dest'), actions_with_value())
def test_an_option_that_is_given_twice_adds_up_or_says_the_same(capsys, prog, dest):
    parser, action = found(prog, dest)
    if not action.option_strings or action.nargs == argparse.REMAINDER:
        return
    first, around = usable(action), words_around(parser, action)
    again = [action.option_strings[-1], *first]
    if not getattr(action, 'adds_up', False):
        assert vars(parse(prog, [*around, *again, *again]))[dest] is not None
    other = other_values(action, first)
    if other is None:
        return
    parsed, told = answer(
        capsys, prog, [*around, *again, action.option_strings[-1], *other])
    if getattr(action, 'adds_up', False):
        assert len(getattr(parsed, dest)) == len(first) + len(other)
    else:
        assert f'{name(action)} is given twice, as ' in told


def other_values(action, first):
    """Return other words that an argument takes, None where it takes one alone."""
    if action.choices:
        return [action.choices[-1]] if len(action.choices) > 1 else None
    if isinstance(action.type, Whole):
        return [f'{action.type.most - 1}', *first[1:]]
    if isinstance(action.type, Number):
        return [f'{(action.type.least + action.type.most) / 2:.17g}', *first[1:]]
    if isinstance(action.type, NumberOrWord):
        return ['7']
    return [f'{first[0]}_else', *first[1:]] if action.type in (None, str, Path) else None


@pytest.mark.parametrize('words', [
    'bag info b --allow-loss --no-allow-loss', 'bag info b --no-allow-loss --allow-loss'])
def test_a_flag_and_its_opposite_are_refused(capsys, words):
    with pytest.raises(SystemExit, match='^2$'):
        argument_parser(['bag']).parse_args(words.split())
    assert 'is given twice, as --' in capsys.readouterr().err


@pytest.mark.parametrize(('words', 'said'), [
    ('report a ./b a/ -o c', 'a is given twice; give it once'),
    ('report a b sub/../a -o c', 'sub/../a is given twice, also as a'),
    ('identify hysteresis a b b -o m.yaml', 'b is given twice'),
    ('identify dynamics --from-response r --from-response ./r -o m', 'r is given twice'),
    ('learn s --parameters r --parameters r -o o', 'r is given twice'),
])
def test_a_file_that_is_given_twice_is_refused(capsys, words, said):
    with pytest.raises(SystemExit, match='^2$'):
        argument_parser(words.split()).parse_args(words.split())
    assert said in capsys.readouterr().err


def test_one_trajectory_may_be_that_of_several_bags():
    parsed = parse('piezo identify dynamics', [
        'a', 'b', '--trajectory', 't', '--trajectory', 't', '-o', 'm'])
    assert parsed.trajectory == [Path('t'), Path('t')]


@pytest.mark.parametrize(('words', 'said'), [
    ('bag salvage b -o c --force', (
        '--force is for piezo bag export, piezo bag motion, not for piezo bag salvage')),
    ('bag salvage b -o c --forse', 'unrecognized arguments: --forse'),
    ('bag export b -o c --forse', "did you mean '--force'?"),
    ('device list --yes', '--yes is for piezo device loopback, piezo device calibrate, not for'),
])
def test_an_option_of_another_command_is_told_so(capsys, words, said):
    with pytest.raises(SystemExit, match='^2$'):
        argument_parser(words.split()).parse_args(words.split())
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith(f'usage: piezo {words.split()[0]} {words.split()[1]} ')


def test_a_small_negative_number_is_a_value():
    assert parse('piezo tune', ['m', '-o', 'o', '--offset-um', '-1e-3']).offset_um == -1e-3
