"""Entry points of the node executables; light, so that a signal during start-up finds them."""

import signal
import sys

__all__ = ['compensator', 'controller', 'loop', 'plant', 'recorder', 'trajectory']

# Readers come up before writers: recorder, compensator, controller, plant, trajectory.
_LOOP = ('compensator', 'controller', 'plant', 'trajectory')


def _run(*names: str) -> int:
    # Until the host takes over, a signal simply ends the process, without a traceback.
    signal.signal(signal.SIGINT, lambda *_: sys.exit(1))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    from importlib import import_module

    from piezo_ros.nodes.host import host

    classes = [
        getattr(import_module(f'piezo_ros.nodes.{name}'), name.capitalize()) for name in names]
    return host(lambda: [stage() for stage in classes])


def plant() -> int:
    """Run the simulated rig."""
    return _run('plant')


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


if __name__ == '__main__':
    name = sys.argv.pop(1)
    sys.exit(_run(*_LOOP) if name == 'loop' else _run(name))
