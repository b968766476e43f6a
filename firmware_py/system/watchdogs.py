"""All who want to hear that the autopilot is alive, told by the loop alone, at the end of a tick."""

from __future__ import annotations

from pathlib import Path

from firmware_py.system.hardware_watchdog import HardwareWatchdog
from firmware_py.system.service_manager import ServiceManager

_THREADS = Path("/proc/self/task")


class Watchdogs:
    """The service manager and the computer's watchdog, as far as there are any."""

    def __init__(self, manager: ServiceManager | None = None, hardware: HardwareWatchdog | None = None) -> None:
        """Take those that there are."""
        self._manager = manager if manager is not None else ServiceManager({})
        self._hardware = hardware
        # Only those may end a process of which a part is stuck that have somebody to start it anew.
        self.awaited = self._manager.present or hardware is not None
        self._status = ""

    def notify_alive(self, now_s: float, status: str = "") -> None:
        """Say that the loop has done all that it is to do in a tick, and how it goes, if that is said."""
        self._status = status or self._status
        self._manager.notify_alive(self._status)
        if self._hardware is not None:
            self._hardware.notify_alive(now_s)

    def stop(self, *, restart: bool) -> None:
        """Say that the process ends; what is to start `restart` stays watched by the computer's watchdog."""
        self._manager.notify_stopping()
        if self._hardware is not None and not restart:
            self._hardware.disarm()


def waits_in_kernel(thread: int) -> bool:
    """Whether a thread of this process waits uninterruptibly, for a disk say: no signal ends such a one."""
    try:
        fields = (_THREADS / str(thread) / "stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return fields.rpartition(")")[2].split()[:1] == ["D"]
