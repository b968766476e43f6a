"""Where the thin log goes: rows are kept until they are on disk, and a file is gone on with by the next start."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from pathlib import Path
from typing import Final

from firmware_py.files.making import DIRECTORY_MODE
from firmware_py.files.reading import open_regular
from firmware_py.log.dataflash import whole_bytes
from firmware_py.log.disk import THIN, LocalDisk, log_files

FILE_BYTES: Final = 1 << 20  # five days, and then it is compressed
ROOM_BYTES: Final = 100_000_000  # a year takes less
MOST_WAITING: Final = 4096  # ticks with rows: two days and more of a disk that is away


class ThinFile:
    """Appends rows to the newest thin log, on the writer's thread; what cannot be written waits and is tried again."""

    def __init__(self, logs: Path, head: bytes) -> None:
        """Write below the directory of the logs; `head` is what a file of ours begins with."""
        self._directory = logs / THIN
        self._head = head
        self._waiting: deque[bytes] = deque()
        self._disk = LocalDisk()
        self._descriptor = -1
        self._size = 0
        self.lost = 0
        self.failure = ""

    def put(self, rows: bytes) -> None:
        """Queue the rows of a tick, on the loop's thread; beyond MOST_WAITING they are lost and counted."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(rows)
        else:
            self.lost += 1

    def drain(self) -> None:
        """Write and sync what waits; an error is kept as text."""
        if not self._waiting:
            return
        count = len(self._waiting)
        data = b"".join(self._waiting[place] for place in range(count))
        try:
            if self._descriptor >= 0 and self._size >= FILE_BYTES:
                self.close()
            if self._descriptor < 0:
                self._open()
            self._append(data)
        except OSError as error:
            self.failure = f"thin log: {error.strerror or error}"
            self.close()
            return
        for _ in range(count):
            self._waiting.popleft()
        self.failure = ""

    def close(self) -> None:
        """Close the file."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1

    def _open(self) -> None:
        """Go on with the newest file if it is one of this version's and not full, else begin one.

        A record that a power cut has torn is taken off: with the next one's begin it would make a false one.
        """
        newest = self._newest()
        if newest is not None:
            self._descriptor = open_regular(newest, flags=os.O_RDWR | os.O_APPEND, follow=False)
            content = os.pread(self._descriptor, FILE_BYTES, 0)
            if len(content) < FILE_BYTES and content.startswith(self._head):
                self._size = whole_bytes(content)
                if self._size < len(content):
                    os.ftruncate(self._descriptor, self._size)
                return
            self.close()
        with contextlib.suppress(FileExistsError):
            self._directory.parent.mkdir(DIRECTORY_MODE)
        self._disk.prune(self._directory, ROOM_BYTES - FILE_BYTES)
        self._descriptor, path = self._disk.create(self._directory)
        self._size = 0
        try:
            self._append(self._head)
        except OSError:
            with contextlib.suppress(OSError):
                self._disk.remove(path)  # else each try would leave one
            raise

    def _newest(self) -> Path | None:
        files = log_files(self._directory) if self._directory.is_dir() else {}
        newest = files[max(files)] if files else None
        return newest if newest is not None and newest.suffix == ".BIN" else None

    def _append(self, data: bytes) -> None:
        """Write all of it and bring it to the medium, or cut the file back to what it was; OSError."""
        written = 0
        try:
            while written < len(data):
                written += os.write(self._descriptor, data[written:])
            self._disk.sync(self._descriptor)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._size)
            raise
        self._size += len(data)
