"""A link that cannot be opened yet: nobody answers for its host's name, or its address is not this computer's.

Whoever steers must not wait for it. A thread tries until it can be opened, since a name server may be waited for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from firmware_py.link.wire.transport import Address, LinkError, LinkUrl, Transport

RETRY_S = 5.0
FIRST_S = 1.0  # the start waits for the first try so long at most


class LateTransport:
    """Nobody is there until it is `opened`; from then on it is what has been opened."""

    byte_rate: float | None = None

    def __init__(self, url: LinkUrl, open_now: Callable[[], Transport], retry_s: float = RETRY_S) -> None:
        """Begin to try `open_now`, which raises LinkError while it cannot be."""
        self.name = url.text
        self.options = url.options
        self.radio = url.options.at_radio_rates(usual=False)
        self.datagrams = url.kind.startswith("udp")
        self.exposed = url.kind.endswith("in") and not url.host.startswith(("127.", "localhost"))
        self.opened: Transport | None = None
        self.problem = f"link {url.text!r}: nobody says where {url.host!r} is"
        self._open_now, self._retry_s = open_now, retry_s
        self._tried, self._ended = threading.Event(), threading.Event()
        threading.Thread(target=self._try, name="link", daemon=True).start()
        self._tried.wait(FIRST_S)

    def _try(self) -> None:
        while self.opened is None and not self._ended.is_set():
            try:
                self.opened = self._open_now()
            except LinkError as error:
                self.problem = str(error)
            self._tried.set()
            if self.opened is None:
                self._ended.wait(self._retry_s)
        if self._ended.is_set():
            self.close()

    def descriptors(self) -> Sequence[int]:
        """Return what there is to be read."""
        return () if self.opened is None else self.opened.descriptors()

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read what has arrived on a descriptor."""
        return () if self.opened is None else self.opened.receive(descriptor)

    def send(self, address: Address, data: bytes) -> bool:
        """Take all of data, or none of it."""
        return self.opened is not None and self.opened.send(address, data)

    @property
    def blocked_reason(self) -> str:
        """Why nothing leaves now."""
        return self.problem if self.opened is None else self.opened.blocked_reason

    def addresses(self) -> Sequence[Address]:
        """Return who is served in any case."""
        return () if self.opened is None else self.opened.addresses()

    def guests(self) -> Sequence[Address]:
        """Return who has connected."""
        return () if self.opened is None else self.opened.guests()

    def host(self, address: Address) -> Address:
        """Return whose correspondent this is."""
        return address if self.opened is None else self.opened.host(address)

    def drop(self, address: Address) -> None:
        """End the connection of a guest."""
        if self.opened is not None:
            self.opened.drop(address)

    def poll(self, now_s: float) -> None:
        """Do what has to be done now and then."""
        if self.opened is not None:
            self.opened.poll(now_s)

    def close(self) -> None:
        """Try no more, and close what has been opened."""
        self._ended.set()
        if self.opened is not None:
            self.opened.close()
