"""What a service manager is told, by the protocol of sd_notify(3): started, alive, stopping, and how it goes.

A datagram of lines `NAME=value` to the socket that NOTIFY_SOCKET names. Nobody waits: a manager that does not listen
loses it.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping
from pathlib import Path

STATUS_CHARACTERS = 120


class ServiceManager:
    """The service manager of this process, or nobody."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Look up in the environment whom to tell, and how often it wants to hear that the process is alive."""
        self._address = _address(environment.get("NOTIFY_SOCKET", ""))
        self.watchdog_s = _watchdog_s(environment) if self._address else None
        self._ready = False
        self._status = ""

    @property
    def present(self) -> bool:
        """Whether there is one."""
        return bool(self._address)

    def notify_alive(self, status: str) -> None:
        """Say that the process is alive; the first time that it has started, and how it goes where that has changed."""
        if not self._address:
            return
        lines = ["WATCHDOG=1"]
        if not self._ready:
            lines.insert(0, "READY=1")
        if status != self._status:
            lines.append(_status_line(status))
        # What did not go out is said again with the next one.
        if self._tell(*lines):
            self._ready, self._status = True, status

    def notify_status(self, text: str) -> None:
        """Say in one line how it goes."""
        self._tell(_status_line(text))

    def notify_stopping(self) -> None:
        """Say that the process ends by itself: the watchdog is to wait for it no longer."""
        self._tell("STOPPING=1")

    def _tell(self, *lines: str) -> bool:
        if not self._address:
            return False
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as ours:
                ours.sendto("\n".join(lines).encode("utf-8", "replace"), self._address)
        except OSError:
            return False
        return True


def _address(name: str) -> str:
    """Return the address of a Unix socket: a path, or an abstract one, which begins with @; empty for any other."""
    if name.startswith("@"):
        return "\0" + name[1:]
    return name if name.startswith("/") else ""


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    """Return the time within which a sign of life is awaited, None where none is, or not of this process."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    with contextlib.suppress(ValueError):
        if (microseconds := int(environment.get("WATCHDOG_USEC", ""))) > 0:
            return microseconds / 1e6
    return None


def _status_line(text: str) -> str:
    return "STATUS=" + " ".join(text.split())[:STATUS_CHARACTERS]


def runtime_directory(environment: Mapping[str, str]) -> Path | None:
    """Return the directory that the manager keeps for this service as long as the computer runs, None without one."""
    first = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(first) if first.startswith("/") else None
