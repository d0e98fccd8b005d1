"""What a process of ours needs of Linux and systemd: the periodic timer, ending signals, sd_notify."""

import asyncio
import ctypes
import os
import signal
import socket
import time
from collections.abc import Callable
from contextlib import suppress

from companion.mavlink.ardusub import NS_PER_S

STOPPING = {signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU}
UNANSWERED = {
    *(signal.SIGKILL, signal.SIGSTOP),
    *(signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH),
    *(signal.SIGPIPE, signal.SIGXFSZ),
    *(signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS),
    signal.SIGABRT,
}
"""Signals without a handler of ours. The first two cannot be handled; the next four do nothing by default;
Python makes the next two an error of the call. After the others this process cannot go on, so that a handler
in Python would never run; systemd ends a loop that hangs by SIGABRT."""


_Itimerspec = ctypes.c_long * 4
"""Interval and start, each in s and ns. They are C's long: 32 bits on a 32-bit system."""


class Ticker:
    """A periodic timerfd on the monotonic clock (os.timerfd_create is there from Python 3.13 only)."""

    def __init__(self, period_ns: int) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self.fd: int = self._libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        self.start_ns = time.monotonic_ns() + period_ns
        spec = _Itimerspec(*divmod(period_ns, NS_PER_S), *divmod(self.start_ns, NS_PER_S))
        absolute = 1
        if self.fd < 0 or self._libc.timerfd_settime(self.fd, absolute, ctypes.byref(spec), None):
            raise OSError(ctypes.get_errno(), "timerfd")

    def read(self) -> int:
        """Return how many periods have passed since the last call; 0 if woken for nothing."""
        try:
            return int.from_bytes(os.read(self.fd, 8), "little")
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Stop ticking."""
        os.close(self.fd)


def on_ending_signal(loop: asyncio.AbstractEventLoop, leave: Callable[[], object]) -> None:
    """Let `leave` answer every signal that would end this process, and ignore those that would stop it.

    A process that ends, or stops (Ctrl-Z), without a word leaves the thrusters running until the autopilot's
    failsafe acts. A SIGHUP that `nohup` has switched off stays so.
    """
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    for number in signal.valid_signals() - UNANSWERED - STOPPING:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            loop.add_signal_handler(number, leave)


def notify(message: str) -> None:
    """Tell systemd, if it started us (sd_notify(3))."""
    address = os.environ.get("NOTIFY_SOCKET")
    if address:
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.sendto(message.encode(), "\0" + address[1:] if address.startswith("@") else address)
