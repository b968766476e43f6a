"""Messages of satellite modems as files: one directory from the boat, one to it, named as gateways name attachments."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

FROM_BOAT: Final = "from-boat"
TO_BOAT: Final = "to-boat"
TAKEN: Final = "taken"
IMEI_DIGITS: Final = 15
_NAME = re.compile(r"(\d{15})_(\d{6})\.sbd")
_MOST_BYTES = 1960  # of any message of any modem


class MessagePost:
    """One of the two directories; whoever takes a message moves it to `taken` in it."""

    def __init__(self, directory: Path, which: str) -> None:
        """Make the directory if it is not there; OSError when that cannot be."""
        self.directory = directory / which
        self._taken = self.directory / TAKEN
        self._taken.mkdir(parents=True, exist_ok=True)

    def put(self, imei: str, number: int, message: bytes) -> bool:
        """Leave a message, whole or not at all; False when this one was left here before."""
        name = f"{imei}_{number:06d}.sbd"
        for place in (self.directory / name, self._taken / name):
            if place.is_file() and place.read_bytes() == message:
                return False
        fresh = self.directory / f".{name}.{os.getpid()}"
        fresh.write_bytes(message)
        fresh.replace(self.directory / name)
        return True

    def take(self) -> Iterator[tuple[str, int, bytes]]:
        """Yield IMEI, number and content of what is there, the oldest first, and move it away."""
        places = [(path, match) for path in self.directory.iterdir() if (match := _NAME.fullmatch(path.name))]
        for path, match in sorted(places, key=lambda place: (place[0].stat().st_mtime_ns, place[0].name)):
            if not path.is_file() or path.stat().st_size > _MOST_BYTES:
                continue
            content = path.read_bytes()
            path.replace(self._taken / path.name)
            yield match[1], int(match[2]), content
