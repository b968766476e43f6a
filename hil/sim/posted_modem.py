"""An Iridium modem whose messages go through a directory, to and from `rambler-hil sbd-gateway`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hil.devices.iridium import IridiumModem
from hil.devices.iridium_network import IridiumNetwork
from hil.devices.message_post import FROM_BOAT, TO_BOAT, MessagePost
from hil.errors import UsageError

PORT = "satellite"  # the name of its line on the board
_LOOK_S = 1.0
_SESSION_S = (4.0, 10.0)  # of a good sky: who looks on need not wait for long
_KIND = "sbd:"


class PostedModem:
    """An emulator: the modem, and a look into the directory each second."""

    def __init__(self, directory: Path, numbers: np.random.Generator) -> None:
        """Take the directory of both ways; OSError when it cannot be used."""
        self.network = IridiumNetwork(numbers, duration_s=_SESSION_S)
        self.modem = IridiumModem(self.network)
        self._out, self._in = MessagePost(directory, FROM_BOAT), MessagePost(directory, TO_BOAT)
        self._look_s = 0.0

    def receive(self, now_s: float, data: bytes) -> None:
        """Take the bytes that the autopilot wrote."""
        self.modem.receive(now_s, data)

    def next_output_s(self) -> float:
        """When the modem has something to say, or the directory is to be looked at."""
        return min(self.modem.next_output_s(), self._look_s)

    def take_output(self, now_s: float) -> bytes:
        """Carry the post and return what the modem says."""
        if now_s >= self._look_s:
            self._look_s = math.floor(now_s / _LOOK_S + 1.0) * _LOOK_S
            while self.network.delivered:
                _, number, message = self.network.delivered.popleft()
                self._out.put(self.modem.imei, number, message)
            for imei, _, message in self._in.take():
                if imei == self.modem.imei and 1 <= len(message) <= 270:
                    self.network.send(message)
        return self.modem.take_output(now_s)


def modem_of(links: Iterable[str], numbers: np.random.Generator) -> PostedModem | None:
    """Return the modem that the links ask for (`sbd:DIR`), None without one; UsageError for more, or no directory."""
    wanted = [link.removeprefix(_KIND) for link in links if link.startswith(_KIND)]
    if not wanted:
        return None
    if len(wanted) > 1:
        raise UsageError("--link sbd:DIR: give one modem")
    try:
        return PostedModem(Path(wanted[0]), numbers)
    except OSError as error:
        raise UsageError(f"--link sbd:{wanted[0]}: {error.strerror}; give a directory for its messages") from None


def on_port(link: str, path: str) -> str:
    """Return a link as the autopilot is to open it: that of the modem on its port."""
    return f"{_KIND}{path}" if link.startswith(_KIND) else link
