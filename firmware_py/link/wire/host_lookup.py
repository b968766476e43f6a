"""Where a host is now: names get other addresses, of stations behind a telephone above all, and nobody waits for that.

A name server may be silent for half a minute, so a thread asks. It stands from the start: one that is begun later would
inherit the priority of the loop.
"""

from __future__ import annotations

import ipaddress
import socket
import threading
from typing import Final

from firmware_py.link.wire.transport import LinkError, LinkUrl

_SELF: Final = "localhost"


def resolve(url: LinkUrl) -> tuple[str, int]:
    """Return the first numeric IPv4 address of a URL, or raise LinkError. May wait for a name server."""
    try:
        return addresses_of(url)[0], url.number
    except (OSError, UnicodeError) as error:
        raise LinkError(f"link {url.text!r}: host {url.host!r} is not known ({error}); use its IPv4 address") from error


def addresses_of(url: LinkUrl) -> tuple[str, ...]:
    """Return the numeric IPv4 addresses of a URL, at least one, or raise OSError or UnicodeError."""
    found = socket.getaddrinfo(url.host, url.number, socket.AF_INET, socket.SOCK_DGRAM)
    return tuple(dict.fromkeys(str(address[4][0]) for address in found))


def is_numeric(host: str) -> bool:
    """Whether a host is an IPv4 address, which means the same for ever."""
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        return False
    return True


class HostLookup:
    """Asks again where a host is; an address is not asked for."""

    def __init__(self, url: LinkUrl, every_s: float) -> None:
        """Take the URL, and how long lies between two questions at least."""
        self._url, self._every_s = url, every_s
        self.found: tuple[str, ...] = ()  # the addresses of the latest answer; none before the first
        self._asked_s: float | None = None
        self._wanted = threading.Event()
        self._ended = False
        if not is_numeric(url.host) and url.host != _SELF:
            threading.Thread(target=self._work, name="link names", daemon=True).start()

    def ask(self, now_s: float) -> None:
        """Ask, unless that was done just now."""
        if self._asked_s is None or now_s - self._asked_s >= self._every_s:
            self._asked_s = now_s
            self._wanted.set()

    def close(self) -> None:
        """End the thread, as soon as nobody keeps it waiting."""
        self._ended = True
        self._wanted.set()

    def _work(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._ended:
                return
            try:
                self.found = addresses_of(self._url)
            except (OSError, UnicodeError):
                continue  # the address that was known may still be right
