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

"""The rest of an interrupted run, up to its end marker, never gets into the next run."""

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.runtime.streams.run_fence import RunFence

# A message is (index, number of samples, name of its run).
_RUNS = st.lists(st.integers(1, 4), max_size=5)


def _messages(sizes, run, end=True):
    messages, index = [], 0
    for size in sizes:
        messages.append((index, size, run))
        index += size
    return [*messages, (index, 0, run)] if end else messages


def _fence(messages):
    waiting = deque(messages)
    fence = RunFence(lambda: waiting.popleft() if waiting else None, lambda message: message[:2])
    return fence, waiting


def _taken(fence, waiting):
    """Return what a run gets: what is held, then what comes, less what the fence keeps out."""
    taken = []
    for message in [*fence.held, *waiting]:
        if taken or not fence.is_rest(*message[:2]):
            taken.append(message)
    return taken


@given(old=_RUNS.filter(bool), new=_RUNS, seen=st.integers(0, 5), come=st.integers(0, 12),
       while_idle=st.booleans(), is_over=st.booleans())
def test_whatever_has_come_or_comes_later_the_new_run_is_whole(
        old, new, seen, come, while_idle, is_over):
    seen = min(seen, len(old))
    before, after = _messages(old, 'old')[:seen], _messages(old, 'old')[seen:]
    following = _messages(new, 'new', end=is_over)
    fence, waiting = _fence([])
    received = sum(size for _, size, _ in before)
    fence.interrupt(received or None)
    rest = [*after, *following]
    # Of a run of which nothing has come, everything is there at the latest when the next begins.
    come = min(come, len(rest)) if received else max(come, len(after))
    waiting.extend(rest[:come])
    if while_idle:
        fence.discard_rest()
    fence.begin(takes_any_start=False)
    assert _taken(fence, [*waiting, *rest[come:]]) == following


def test_a_source_that_begins_again_without_an_end_marker_is_heard():
    fence, waiting = _fence([(0, 5, 'new'), (5, 5, 'new')])
    fence.interrupt(7)
    fence.begin(takes_any_start=False)
    assert _taken(fence, waiting) == [(0, 5, 'new'), (5, 5, 'new')]


def test_a_late_joiner_takes_what_goes_on():
    fence, waiting = _fence([(7, 5, 'old')])
    fence.interrupt(7)
    fence.begin(takes_any_start=True)
    assert _taken(fence, [(12, 5, 'the same')]) == [(12, 5, 'the same')]
    assert not waiting


def test_a_malformed_message_of_the_interrupted_run_goes_too():
    def extent(message):
        if message == 'malformed':
            raise ValueError(message)
        return message

    waiting = deque(['malformed', (3, 0), (0, 1)])
    fence = RunFence(lambda: waiting.popleft() if waiting else None, extent)
    fence.interrupt(3)
    fence.begin(takes_any_start=False)
    assert [*fence.held, *waiting] == [(0, 1)]


def test_a_run_that_ended_needs_no_fence():
    fence, waiting = _fence([(3, 2, 'new')])
    fence.begin(takes_any_start=False)
    assert not fence.is_rest(3, 2)
    assert list(waiting) == [(3, 2, 'new')]
