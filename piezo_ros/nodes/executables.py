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

"""Entry points of the node executables; light, so that a signal during start-up finds them."""

import ctypes
import os
import signal
import sys
from typing import TYPE_CHECKING, Any

from piezo_ros.crash_report import report_crashes
from piezo_ros.interruption import leave_closed_terminal, set_stop_handler
from piezo_ros.matrix_threads import use_one_thread
from piezo_ros.resource_limits import GRAPH_BYTES, memory_problem
from piezo_ros.runtime.process.parent import PARENT_VARIABLE
from piezo_ros.suggestions import did_you_mean

if TYPE_CHECKING:
    from piezo_ros.control import ControlLaw
    from piezo_ros.nodes.learner_parts.learning_protocol import MakeLearning

__all__ = [
    'compensator',
    'controller',
    'hardware_plant',
    'loop',
    'plant',
    'recorder',
    'run_controller',
    'run_learner',
    'stamped',
    'trajectory',
]

_PR_SET_PDEATHSIG = 1

# Readers come up before writers: recorder, compensator, controller, plant, trajectory.
_LOOP = ('compensator', 'controller', 'plant', 'trajectory')


def run_controller(control_law: 'type[ControlLaw]') -> int:
    """
    Run the controller node with a control law of your own.

    Parameters
    ----------
    control_law : type
        Subclass of `piezo_ros.control.ControlLaw`.

    Returns
    -------
    int
        Exit code, for an entry point.

    """
    return _run('controller', control_law=control_law)


def run_learner(make_learning: 'MakeLearning') -> int:
    """
    Run the learner node.

    Parameters
    ----------
    make_learning : callable
        Makes what learns, see `piezo_ros.nodes.learner_parts.learning_protocol`.

    Returns
    -------
    int
        Exit code, for an entry point.

    """
    return _run('learner', make_learning=make_learning)


def _run(*names: str, **own: Any) -> int:
    # Until the host takes over, a signal simply ends the process, without a traceback.
    set_stop_handler(_end_start)
    report_crashes()
    problem = memory_problem(GRAPH_BYTES)
    if problem:
        print(problem, file=sys.stderr)
        return 1
    _follow_parent()
    use_one_thread()
    from importlib import import_module

    from piezo_ros.nodes.usage import answer_usage
    code = answer_usage(names, sys.argv)
    if code is not None:
        return code

    from piezo_ros.runtime.host import host

    classes = [
        getattr(import_module(f'piezo_ros.nodes.{name}'), _class_name(name)) for name in names]
    # Several nodes in one process share the time that the compiler's import takes.
    code = host(lambda: [node(compiled=len(classes) > 1, **own) for node in classes])
    # While Python shuts down, a signal would kill it, and its exit code would be lost.
    set_stop_handler(signal.SIG_IGN)
    return code


def _class_name(module: str) -> str:
    return module.title().replace('_', '')


def _end_start(number: int, _frame: object) -> None:
    """End the process, of which no ROS knows yet."""
    leave_closed_terminal()
    print(f'ended by {signal.Signals(number).name} while it started', file=sys.stderr, flush=True)
    # Not by an exception: Python drops one that is raised where an import cleans up.
    os._exit(0)


def _follow_parent() -> None:
    """Take signals from the supervisor alone, and a SIGINT at its end, if there is one."""
    parent = os.environ.get(PARENT_VARIABLE)
    if parent is None or not sys.platform.startswith('linux'):
        return
    # A group of its own: a Ctrl-C reaches it through the supervisor, in order. Not a session of its
    # own: Linux shares the processor among sessions, and yielding within one does not help another.
    os.setpgid(0, 0)
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
    if os.getppid() != int(parent):
        sys.exit(1)


def plant() -> int:
    """Run the simulated rig."""
    return _run('plant')


def hardware_plant() -> int:
    """Run a real stage in place of the simulated rig."""
    return _run('hardware_plant')


def compensator() -> int:
    """Run the inverse hysteresis model."""
    return _run('compensator')


def controller() -> int:
    """Run the controller."""
    return _run('controller')


def trajectory() -> int:
    """Run the trajectory generator."""
    return _run('trajectory')


def recorder() -> int:
    """Run the recorder."""
    return _run('recorder')


def loop() -> int:
    """Run compensator, controller, plant and trajectory in one process."""
    return _run(*_LOOP)


def stamped() -> int:
    """Run the onlooker that offers the streams as stamped messages."""
    set_stop_handler(_end_start)
    report_crashes()
    from piezo_ros.nodes.usage import answer_usage
    code = answer_usage(['stamped'], sys.argv)
    if code is not None:
        return code
    from piezo_ros.nodes.stamped_parts.stamped_process import main

    return main()


if __name__ == '__main__':
    name, known = ''.join(sys.argv[1:2]), {each.__name__: each for each in (
        plant, hardware_plant, compensator, controller, trajectory, recorder, loop, stamped)}
    del sys.argv[1:2]
    if name not in known:
        print(
            f'{name!r} is no executable of this module; there are {", ".join(known)}'
            f'{did_you_mean(name, known)}', file=sys.stderr)
    sys.exit(known[name]() if name in known else 2)
