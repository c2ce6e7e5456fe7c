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
Results of fault trials as files: each kind of trial adds to one JSON file, a page shows all.

    PYTHONPATH=. python test/support/fault_results.py docs/faults docs/failure-matrix.md

Options of the trials come from the environment: `PIEZO_FAULT_TRIALS` (how many), `PIEZO_FAULT_SEED`
(number of the first), `PIEZO_FAULT_RESULTS` (directory of the JSON files; none by default).
"""

import datetime
import json
import os
import platform
import subprocess
import sys
from collections import Counter
from pathlib import Path

__all__ = ['add_results', 'first_trial', 'number_of_trials']

HEAD = """\
# Failure matrix

What was broken on purpose, how often, and what came of it. The trials are tests: `make test` runs a
small share of them, `make test-slow` more, and with `PIEZO_FAULT_TRIALS=2000` before it as many as
that; `PIEZO_FAULT_SEED` is the number of the first. This page is made from the files in `faults/`
by `test/support/fault_results.py`; `PIEZO_FAULT_RESULTS=docs/faults` lets the tests add to them.

A trial fails if any of these does not hold:

* **bags**: `piezo bag info`, reading and salvage end with the package's own error or a result;
  every sample is what was recorded at its index; a sample that is missing is told; what is salvaged
  is whole.
* **messages**: a node refuses and counts what is no block, or ends its run with the reason; it
  answers the right blocks around it with the right bits.
* **live**: exit code 0 only for a whole run, no traceback, no process left, the bag readable with
  the samples of the offline simulation, the voltage zero or told as unknown.
* **starts beside twins**: beside idle nodes of the same full names no process of a composed loop
  and its recorder dies by a signal that it was not sent; a run that is not interrupted is whole.

A failure stays in the record. Where a later session repeats its number without one, what failed is
mended: the code or, for what a trial had asked wrongly, the trial.
"""


def number_of_trials(default):
    """Return how many trials are asked for."""
    return int(os.environ.get('PIEZO_FAULT_TRIALS', default))


def first_trial():
    """Return the number of the first trial."""
    return int(os.environ.get('PIEZO_FAULT_SEED', '0'))


def add_results(kind, counts, failures, trials):
    """
    Add the outcome of trials to the file of their kind, where results are asked for.

    Parameters
    ----------
    kind : str
        Name of the file.
    counts : Counter
        (cell, outcome) to number of trials.
    failures : list of str
        What did not hold.
    trials : range
        Numbers of the trials.

    """
    directory = os.environ.get('PIEZO_FAULT_RESULTS')
    if not directory:
        return
    path = Path(directory) / f'{kind}.json'
    path.parent.mkdir(parents=True, exist_ok=True)
    content = json.loads(path.read_text()) if path.exists() else {'sessions': [], 'counts': {}}
    content['sessions'].append({
        'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC'),
        'commit': _commit(), 'python': platform.python_version(),
        'load': round(os.getloadavg()[0], 1), 'first': trials.start, 'trials': len(trials),
        'failures': failures})
    for (cell, outcome), number in counts.items():
        outcomes = content['counts'].setdefault(cell, {})
        outcomes[outcome] = outcomes.get(outcome, 0) + number
    content['counts'] = dict(sorted(content['counts'].items()))
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + '\n')


def _commit():
    """Return the commit; -dirty where other files than the results of sessions before differ."""
    def told(*words):
        done = subprocess.run(
            ['git', *words], cwd=Path(__file__).parent, capture_output=True, text=True,
            check=False)
        return done.stdout.strip()

    changed = told('status', '--porcelain', '--untracked-files=no', '--', ':/', ':!/docs/faults')
    return (told('describe', '--always', '--abbrev=9') or 'unknown') + '-dirty' * bool(changed)


def page(directory):
    """Return the page that shows the results in a directory."""
    parts = [HEAD]
    for path in sorted(Path(directory).glob('*.json')):
        content = json.loads(path.read_text())
        outcomes = sorted({name for cell in content['counts'].values() for name in cell})
        total = Counter()
        for cell in content['counts'].values():
            total.update(cell)
        sessions = content['sessions']
        failures = [failure for session in sessions for failure in session['failures']]
        parts += [
            f'\n## {path.stem.replace("_", " ").capitalize()}\n\n',
            f'Trials: {sum(session["trials"] for session in sessions)}. ',
            f'Failures: {len(failures)}.\n\n',
            '| date | commit | Python | load | trials | failed |\n|---|---|---|---|---|---|\n']
        parts += [
            f'| {session["date"]} | {session["commit"]} | {session["python"]} '
            f'| {session["load"]} | {session["trials"]} from {session["first"]} '
            f'| {len(session["failures"])} |\n' for session in sessions]
        parts += [
            f'\n| cell | {" | ".join(outcomes)} |\n|{"---|" * (len(outcomes) + 1)}\n',
            *(f'| {cell.replace("|", "/")} '
              f'| {" | ".join(str(counts.get(name, 0)) for name in outcomes)} |\n'
              for cell, counts in content['counts'].items()),
            f'| all | {" | ".join(str(total[name]) for name in outcomes)} |\n']
        if failures:
            parts += ['\nFailed:\n\n', *(f'    {failure}\n' for failure in failures)]
    return ''.join(parts)


if __name__ == '__main__':
    Path(sys.argv[2]).write_text(page(sys.argv[1]))
