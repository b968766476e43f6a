"""The computer's own watchdog: it starts the computer anew unless it is told in time that the autopilot is alive.

The kernel's watchdog interface (Documentation/watchdog/watchdog-api.rst): opening the device arms it, any byte
written is a sign of life, `V` as the last one disarms it where the driver allows that.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
import struct
from pathlib import Path

TIMEOUT_S = 15  # the longest that the one of the Raspberry Pi takes
INTERVAL_S = 2.0
_SET_TIMEOUT = 0xC0045706  # _IOWR('W', 6, int)
_SIGN, _DISARM = b"\0", b"V"
_REMEDY = "correct --watchdog, or leave it out"


class WatchdogError(RuntimeError):
    """The watchdog cannot be had; the text names it and the remedy."""


class HardwareWatchdog:
    """A watchdog device, armed as long as this is open."""

    def __init__(self, path: Path) -> None:
        """Open and arm it; WatchdogError when that cannot be."""
        self._due_s = 0.0
        self.note = ""  # what is not as asked for
        try:
            if not stat.S_ISCHR(path.stat().st_mode):
                raise OSError(errno.ENODEV, "is no device of that kind")  # noqa: TRY301 - told like all others
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            busy = "in use, by systemd perhaps (RuntimeWatchdogSec)" if error.errno == errno.EBUSY else error.strerror
            raise WatchdogError(f"watchdog {path}: {busy}; {_REMEDY}") from None
        try:
            answer = fcntl.ioctl(self._descriptor, _SET_TIMEOUT, struct.pack("i", TIMEOUT_S))
            (timeout_s,) = struct.unpack("i", answer)
            if timeout_s != TIMEOUT_S:
                self.note = f"watchdog {path}: {timeout_s} s instead of {TIMEOUT_S} s"
        except OSError as error:
            self.note = f"watchdog {path}: its time cannot be set ({error.strerror}); the driver's own holds"

    def notify_alive(self, now_s: float) -> None:
        """Tell it, every INTERVAL_S at most; one that takes nothing starts the computer anew."""
        if now_s >= self._due_s:
            self._due_s = now_s + INTERVAL_S
            self._write(_SIGN)

    def disarm(self) -> None:
        """Disarm it, where the driver allows that, and close it."""
        self._write(_DISARM)
        with contextlib.suppress(OSError):
            os.close(self._descriptor)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self._descriptor, data)
