"""The way out of a process whose middleware hangs while it is taken down."""

import ctypes
import sys

__all__ = ['exit_after']

_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _Notification(ctypes.Structure):
    """The ``sigevent`` of Linux: call a function with a value, in a thread of its own."""

    _fields_ = (
        ('value', ctypes.c_ssize_t),
        ('signal_number', ctypes.c_int),
        ('kind', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


class _Time(ctypes.Structure):
    """The ``itimerspec``: never again, and first after so long."""

    _fields_ = tuple(
        (name, ctypes.c_long)
        for name in ('again_s', 'again_ns', 'first_s', 'first_ns'))


def exit_after(grace_s: float, code: int) -> None:
    """
    End this process with an exit code, unless it has ended by itself in time.

    Fast DDS 3.2 hangs for ever, and Python with it, if somebody else's endpoint comes or goes while
    its participant is destroyed: it waits with an overflown deadline and keeps the lock that who is
    waited for needs. No thread of Python gets to run any more, so the C library must do it.

    Parameters
    ----------
    grace_s : float
        How long it may take to end by itself, seconds.
    code : int
        The exit code.

    """
    if not sys.platform.startswith('linux'):
        return
    library = ctypes.CDLL(None)
    if not hasattr(library, 'timer_create'):  # a C library from before 2021
        library = ctypes.CDLL('librt.so.1')
    timer = ctypes.c_void_p()
    notification = _Notification(
        value=code, kind=_SIGEV_THREAD,
        function=ctypes.cast(ctypes.CDLL(None)._exit, ctypes.c_void_p))
    time = _Time(first_s=int(grace_s), first_ns=int(grace_s % 1.0 * 1e9))
    if library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(notification), ctypes.byref(timer)) == 0:
        library.timer_settime(timer, 0, ctypes.byref(time), None)
