"""An Iridium modem that exchanges its messages with `rambler-hil sbd-gateway` through a directory."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hil.devices.iridium import IridiumModem
from hil.devices.iridium_network import IridiumNetwork
from hil.devices.message_post import FROM_BOAT, TO_BOAT, MessagePost
from hil.errors import UsageError

PORT = "satellite"  # name of the modem's line on the board
_POLL_S = 1.0
_SESSION_S = (4.0, 10.0)  # range of durations; short, because an operator may wait for it
_PREFIX = "sbd:"


class DirectoryModem:
    """An emulator of the modem that also polls the directory each second."""

    def __init__(self, directory: Path, rng: np.random.Generator) -> None:
        """Create the subdirectories for both directions; raise OSError if that fails."""
        self.network = IridiumNetwork(rng, duration_s=_SESSION_S)
        self.modem = IridiumModem(self.network)
        self._from_boat, self._to_boat = MessagePost(directory, FROM_BOAT), MessagePost(directory, TO_BOAT)
        self._next_poll_s = 0.0

    def receive(self, now_s: float, data: bytes) -> None:
        """Process the bytes that the autopilot wrote."""
        self.modem.receive(now_s, data)

    def next_output_s(self) -> float:
        """Return the time of the modem's next output or of the next poll."""
        return min(self.modem.next_output_s(), self._next_poll_s)

    def take_output(self, now_s: float) -> bytes:
        """Exchange messages with the directory and return the modem's output."""
        if now_s >= self._next_poll_s:
            self._next_poll_s = math.floor(now_s / _POLL_S + 1.0) * _POLL_S
            while self.network.delivered:
                _, number, message = self.network.delivered.popleft()
                self._from_boat.put(self.modem.imei, number, message)
            for imei, _, message in self._to_boat.take():
                if imei == self.modem.imei and 1 <= len(message) <= 270:
                    self.network.send(message)
        return self.modem.take_output(now_s)


def make_modem(links: Iterable[str], rng: np.random.Generator) -> DirectoryModem | None:
    """Return the modem of the link `sbd:DIR`, or None; raise UsageError for two links or an unusable directory."""
    directories = [link.removeprefix(_PREFIX) for link in links if link.startswith(_PREFIX)]
    if not directories:
        return None
    if len(directories) > 1:
        raise UsageError("--link sbd:DIR is given twice; give it once")
    try:
        return DirectoryModem(Path(directories[0]), rng)
    except OSError as error:
        raise UsageError(f"--link sbd:{directories[0]}: {error.strerror}; give a directory for its messages") from None


def link_to_port(link: str, path: str) -> str:
    """Return the link that the autopilot opens: for the modem the path of its port, otherwise the link itself."""
    return f"{_PREFIX}{path}" if link.startswith(_PREFIX) else link
