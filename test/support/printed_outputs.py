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
The outputs that docs/your-own-stage.md shows, printed by the commands that it names.

``make outputs`` (``python test/support/printed_outputs.py``) writes them into the page; a slow test
compares the page with them. A block stands between ``<!-- printed: NAME -->`` and ``<!-- end -->``.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import sys
import tempfile
from pathlib import Path

from piezo_ros.cli.main import main

__all__ = ['PAGE', 'printed_outputs', 'with_outputs']

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'your-own-stage.md'
STAGE = ROOT / 'config' / 'examples' / 'slow_stage'
# Name of a block -> the command that prints it; what has no name is done on the way.
COMMANDS = (
    ('', 'simulate identify.yaml -o runs'),
    ('hysteresis', 'identify hysteresis runs/bags/000_* -o compensator.yaml'),
    ('comparison', 'identify hysteresis runs/bags/000_* --compare -o compared.yaml'),
    ('dynamics', (
        'identify dynamics runs/bags/001_* --compensator compensator.yaml -o trajectory.yaml')),
    ('tune', (
        'tune trajectory.yaml --compensator compensator.yaml --plant rig.yaml --bound none '
        '--sample-period-s 1e-4 --frequencies-hz 14 28 57 110 -o controller.yaml')),
    ('plan', (
        'plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml --amplitude-um 8 '
        '--frequency-hz 200 --sample-period-s 1e-4 -o fast.yaml')),
    ('learn', 'learn fast.yaml --parameters rig.yaml --runs 3 --compare --offline -o learned'),
)
_BLOCK = re.compile(r'(<!-- printed: (\w+) -->\n\n)(.*?)(\n\n<!-- end -->)', re.DOTALL)
_FILES = re.compile(r'^(model|gains|scan|report|next): .*\n?', re.MULTILINE)


def printed_outputs(directory, commands=COMMANDS):
    """Run the commands in a copy of the stage and return name -> what they print."""
    shutil.copytree(STAGE, directory, dirs_exist_ok=True)
    found = {}
    with _inside(directory):
        for name, command in commands:
            words = [
                path for word in shlex.split(command)
                for path in (sorted(map(str, Path().glob(word))) if '*' in word else [word])]
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                code = main(words)
            if code not in (0, 4):
                raise RuntimeError(f'{command} ended with {code}')
            if name:
                found[name] = _FILES.sub('', out.getvalue()).strip('\n')
    # The part that the page shows of the comparison is its table.
    if 'comparison' in found:
        found['comparison'] = found['comparison'][found['comparison'].index('model  '):]
    return found


@contextlib.contextmanager
def _inside(directory):
    """Change into a directory for a while."""
    before = Path.cwd()
    os.chdir(directory)
    try:
        yield
    finally:
        os.chdir(before)


def with_outputs(text, outputs):
    """Return the text of a page with its blocks replaced."""
    def block(match):
        lines = outputs[match[2]].splitlines()
        return match[1] + '\n'.join(f'    {line}'.rstrip() for line in lines) + match[4]
    return _BLOCK.sub(block, text)


if __name__ == '__main__':
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    with tempfile.TemporaryDirectory() as folder:
        page = with_outputs(PAGE.read_text(encoding='utf-8'), printed_outputs(Path(folder)))
    PAGE.write_text(page, encoding='utf-8')
    sys.exit(0)
