"""Notifies the service manager with the protocol of sd_notify(3): ready, alive, stopping, status.

A notification is a datagram of lines `NAME=value`, sent without blocking to the socket named in NOTIFY_SOCKET.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping
from pathlib import Path

MAX_STATUS_CHARACTERS = 120


class ServiceManager:
    """Connection to the service manager of this process; without one, notifications do nothing."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Read the address and the watchdog time from the environment."""
        self._address = _parse_address(environment.get("NOTIFY_SOCKET", ""))
        self.watchdog_s = _parse_watchdog_s(environment) if self._address else None
        self._has_sent_ready = False
        self._last_status = ""

    @property
    def is_present(self) -> bool:
        """Whether this process has a service manager."""
        return bool(self._address)

    def notify_alive(self, status: str) -> None:
        """Send WATCHDOG=1, with READY=1 the first time, and with the status if it has changed."""
        if not self._address:
            return
        lines = ["WATCHDOG=1"]
        if not self._has_sent_ready:
            lines.insert(0, "READY=1")
        if status != self._last_status:
            lines.append(_status_line(status))
        # A failed notification is repeated with the next one.
        if self._send(*lines):
            self._has_sent_ready, self._last_status = True, status

    def notify_status(self, text: str) -> None:
        """Send a status text; only its first MAX_STATUS_CHARACTERS are sent."""
        self._send(_status_line(text))

    def notify_stopping(self) -> None:
        """Send STOPPING=1, which ends the watchdog supervision."""
        self._send("STOPPING=1")

    def _send(self, *lines: str) -> bool:
        if not self._address:
            return False
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sender:
                sender.sendto("\n".join(lines).encode("utf-8", "replace"), self._address)
        except OSError:
            return False
        return True


def _parse_address(name: str) -> str:
    """Return the address of a Unix socket, empty if the name is not one.

    A name is an absolute path, or @ and the name of an abstract socket.
    """
    if name.startswith("@"):
        return "\0" + name[1:]
    return name if name.startswith("/") else ""


def _parse_watchdog_s(environment: Mapping[str, str]) -> float | None:
    """Return the watchdog timeout in seconds; None if there is none, or if it applies to another process."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    with contextlib.suppress(ValueError):
        if (microseconds := int(environment.get("WATCHDOG_USEC", ""))) > 0:
            return microseconds / 1e6
    return None


def _status_line(text: str) -> str:
    return "STATUS=" + " ".join(text.split())[:MAX_STATUS_CHARACTERS]


def runtime_directory(environment: Mapping[str, str]) -> Path | None:
    """Return the runtime directory of the service, which exists until the next boot; None without one."""
    path = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(path) if path.startswith("/") else None
