"""Watchdogs of the service manager and of the computer, which the loop resets at the end of each tick."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
import struct
from pathlib import Path

from firmware_py.system.service_manager import ServiceManager

_THREADS = Path("/proc/self/task")
TIMEOUT_S = 15  # the maximum of the Raspberry Pi
INTERVAL_S = 2.0
_SET_TIMEOUT = 0xC0045706  # WDIOC_SETTIMEOUT of linux/watchdog.h, _IOWR('W', 6, int)
_RESET, _DISARM = b"\0", b"V"
_REMEDY = "correct --watchdog, or leave it out"


class WatchdogError(RuntimeError):
    """The watchdog cannot be opened; the text names the device and the remedy."""


class HardwareWatchdog:
    """A watchdog device, which is armed while it is open."""

    def __init__(self, path: Path) -> None:
        """Open and arm the device; raises WatchdogError."""
        self._due_s = 0.0
        self.note = ""  # a deviation from the requested timeout
        try:
            if not stat.S_ISCHR(path.stat().st_mode):
                raise OSError(errno.ENODEV, "not a watchdog device")  # noqa: TRY301 - reported like the others
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            reason = "in use, by systemd perhaps (RuntimeWatchdogSec)" if error.errno == errno.EBUSY else error.strerror
            raise WatchdogError(f"watchdog {path}: {reason}; {_REMEDY}") from None
        try:
            reply = fcntl.ioctl(self._descriptor, _SET_TIMEOUT, struct.pack("i", TIMEOUT_S))
            (timeout_s,) = struct.unpack("i", reply)
            if timeout_s != TIMEOUT_S:
                self.note = f"watchdog {path}: {timeout_s} s instead of {TIMEOUT_S} s"
        except OSError as error:
            self.note = f"watchdog {path}: timeout not set ({error.strerror}); using the driver's default"

    def notify_alive(self, now_s: float) -> None:
        """Reset the watchdog, at most every INTERVAL_S; after write errors it reboots the computer."""
        if now_s >= self._due_s:
            self._due_s = now_s + INTERVAL_S
            self._write(_RESET)

    def disarm(self) -> None:
        """Disarm the watchdog, if the driver allows that, and close the device."""
        self._write(_DISARM)
        with contextlib.suppress(OSError):
            os.close(self._descriptor)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self._descriptor, data)


class Watchdogs:
    """The available watchdogs of the service manager and of the computer."""

    def __init__(self, manager: ServiceManager | None = None, hardware: HardwareWatchdog | None = None) -> None:
        """Store the available watchdogs."""
        self._manager = manager if manager is not None else ServiceManager({})
        self._hardware = hardware
        # If nothing restarts the process, it must not end because of a stuck thread.
        self.can_restart = self._manager.is_present or hardware is not None
        self._status = ""

    def notify_alive(self, now_s: float, status: str = "") -> None:
        """Reset the watchdogs after a tick; an empty status repeats the last one."""
        self._status = status or self._status
        self._manager.notify_alive(self._status)
        if self._hardware is not None:
            self._hardware.notify_alive(now_s)

    def stop(self, *, restart: bool) -> None:
        """Notify that the process ends; before a restart the hardware watchdog stays armed."""
        self._manager.notify_stopping()
        if self._hardware is not None and not restart:
            self._hardware.disarm()


def is_in_uninterruptible_wait(thread: int) -> bool:
    """Return whether a thread of this process is in uninterruptible sleep, as for a disk; no signal ends it."""
    try:
        fields = (_THREADS / str(thread) / "stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return fields.rpartition(")")[2].split()[:1] == ["D"]
