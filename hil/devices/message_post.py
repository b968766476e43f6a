"""Messages of satellite modems as files: one directory from the boat, one to it, named as gateways name attachments."""

from __future__ import annotations

import os
import re
import stat
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
        self._named: set[str] = set()
        self.problems: list[str] = []  # of files that are left where they are, each once

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
        """Yield IMEI, number and content of what is there, the oldest first, and move it away.

        What is no file of a message, such as a link, is left there, and is a problem.
        """
        found = []
        try:
            names = [path.name for path in self.directory.iterdir() if _NAME.fullmatch(path.name)]
        except OSError as error:
            self._leave(self.directory.name, error.strerror or "")
            return
        self._named.intersection_update(names)
        for name in names:
            try:
                status = (self.directory / name).lstat()
            except OSError as error:
                self._leave(name, error.strerror or "")
                continue
            if stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES:
                found.append((status.st_mtime_ns, name))
            else:
                self._leave(name, f"no file of at most {_MOST_BYTES} bytes")
        for _, name in sorted(found):
            path = self.directory / name
            try:
                content = path.read_bytes()
                path.replace(self._taken / name)
            except OSError as error:
                self._leave(name, error.strerror or "")
                continue
            yield name[:IMEI_DIGITS], int(name[IMEI_DIGITS + 1 : -4]), content

    def _leave(self, name: str, why: str) -> None:
        if name not in self._named:
            self._named.add(name)
            self.problems.append(f"{name} is left where it is: {why}")
