"""Messages of satellite modems as files, one directory for each direction; names as of attachments of the gateway."""

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
_MAX_BYTES = 1960  # of a message of any modem


class MessagePost:
    """One of the two directories; messages that were read are moved to its subdirectory `taken`."""

    def __init__(self, directory: Path, direction: str) -> None:
        """Create the directory if necessary; raise OSError if that fails."""
        self.directory = directory / direction
        self._taken_directory = self.directory / TAKEN
        self._taken_directory.mkdir(parents=True, exist_ok=True)
        self._reported: set[str] = set()
        self.problems: list[str] = []  # one text for each file that is skipped

    def put(self, imei: str, number: int, message: bytes) -> bool:
        """Write a message atomically; return False if it was written before."""
        name = f"{imei}_{number:06d}.sbd"
        for path in (self.directory / name, self._taken_directory / name):
            if path.is_file() and path.read_bytes() == message:
                return False
        temporary = self.directory / f".{name}.{os.getpid()}"
        temporary.write_bytes(message)
        temporary.replace(self.directory / name)
        return True

    def take(self) -> Iterator[tuple[str, int, bytes]]:
        """Yield IMEI, number and content of the messages, the oldest first, and move them to `taken`.

        Other files, such as links, are skipped and reported as a problem.
        """
        messages = []
        try:
            names = [path.name for path in self.directory.iterdir() if _NAME.fullmatch(path.name)]
        except OSError as error:
            self._skip(self.directory.name, error.strerror or "")
            return
        self._reported.intersection_update(names)
        for name in names:
            try:
                status = (self.directory / name).lstat()
            except OSError as error:
                self._skip(name, error.strerror or "")
                continue
            if stat.S_ISREG(status.st_mode) and status.st_size <= _MAX_BYTES:
                messages.append((status.st_mtime_ns, name))
            else:
                self._skip(name, f"not a file of at most {_MAX_BYTES} bytes")
        for _, name in sorted(messages):
            path = self.directory / name
            try:
                content = path.read_bytes()
                path.replace(self._taken_directory / name)
            except OSError as error:
                self._skip(name, error.strerror or "")
                continue
            yield name[:IMEI_DIGITS], int(name[IMEI_DIGITS + 1 : -4]), content

    def _skip(self, name: str, reason: str) -> None:
        if name not in self._reported:
            self._reported.add(name)
            self.problems.append(f"{name} is skipped: {reason}")
