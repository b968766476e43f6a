"""Chooses one of several devices of an NMEA 2000 bus that send the same quantity, by its source address."""

from __future__ import annotations

import math

from firmware_py.sensors.nmea2000_frames import MAX_ADDRESS

AUTOMATIC = -1  # as address: the first device that sends the quantity
_MANUFACTURER_BIT, _UNIQUE_NUMBER_BITS = 21, 21


class SourceSelection:
    """Follows one device: that of the configured address, or the first one that sends, until it is silent.

    A device may change its address; its address claim (PGN 60928) contains its NAME, 8 bytes that are unique in the
    world. If the claim of the selected device was received, the selection follows it to its new address, and another
    device that takes its old address is not used.
    """

    def __init__(self, quantity: str, address: int, timeout_s: float) -> None:
        """Select the device with this address, or AUTOMATIC; `quantity` is for texts, such as "heading"."""
        self._quantity = quantity
        self._configured = address
        self._timeout_s = timeout_s
        self._names: dict[int, bytes] = {}  # by address
        self._reported: set[int] = set()
        self._unused: int | None = None  # another device that sends the quantity
        self._address: int | None = None
        self._name: bytes | None = None
        self._newest_s = -math.inf
        self._text = ""

    @property
    def address(self) -> int | None:
        """The address of the selected device; None before its first message, or after another device has taken it."""
        return self._address

    def restart(self) -> None:
        """Forget the selected device and all names: the bus may be another one."""
        self._names.clear()
        self._reported.clear()
        self._unused = None
        self._address = self._name = None
        self._newest_s = -math.inf

    def is_candidate(self, source: int) -> bool:
        """Return whether the device of this address could be selected."""
        return source <= MAX_ADDRESS and (self._configured in (AUTOMATIC, source) or source == self._address)

    def accepts(self, source: int, now_s: float) -> bool:
        """Return whether to use a message of the quantity from this address; select its device if none is active."""
        if source > MAX_ADDRESS:
            return False
        if source != self._address:
            if not self.is_candidate(source) or now_s - self._newest_s <= self._timeout_s:
                self._report_unused(source)
                return False
            if self._address is not None:
                self._text = f"{self._quantity} source {_describe(self._address, self._name)} silent: "
                self._text += f"{_describe(source, self._names.get(source))} used"
            self._address, self._name = source, self._names.get(source)
        self._newest_s = now_s
        return True

    def handle_claim(self, source: int, name: bytes, now_s: float) -> None:
        """Process an address claim: `name` has claimed `source`."""
        self._names[source] = name
        if source == self._address:
            if self._name is None:
                self._name = name
            elif name != self._name:
                # Another device has taken the address. The selected one may claim another address now.
                self._address, self._newest_s = None, now_s
        elif name == self._name and source <= MAX_ADDRESS:
            self._address, self._newest_s = source, now_s

    def take_text(self) -> str:
        """Return a report of a change or of a device that is not used, once; empty for none."""
        text, self._text = self._text, ""
        return text

    @property
    def missing_text(self) -> str:
        """States that another device sends, but not the configured one; empty if the latter sends or no device does."""
        if self._unused is None or self._address is not None:
            return ""
        return f"no {self._quantity} from source 0x{self._configured:02x}, but from 0x{self._unused:02x}"

    def _report_unused(self, source: int) -> None:
        if self._address is None and self._configured not in (AUTOMATIC, source):
            self._unused = source  # `missing_text` reports it
            return
        if source not in self._reported:
            self._reported.add(source)
            self._text = f"second {self._quantity} source {_describe(source, self._names.get(source))} not used"


def _describe(address: int, name: bytes | None) -> str:
    """Return an address, with manufacturer code and unique number of the device if its NAME is known."""
    if name is None:
        return f"0x{address:02x}"
    number = int.from_bytes(name, "little")
    manufacturer = number >> _MANUFACTURER_BIT & 0x7FF
    return f"0x{address:02x} (maker {manufacturer}, no. {number & ((1 << _UNIQUE_NUMBER_BITS) - 1)})"
