"""Writes the thin log: rows stay queued until they are on disk, and each start continues the newest file."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from pathlib import Path
from typing import Final

from firmware_py.files.reading import open_regular
from firmware_py.files.writing import DIRECTORY_MODE
from firmware_py.log.dataflash import whole_bytes
from firmware_py.log.disk import THIN, LocalDisk, log_files

FILE_BYTES: Final = 1 << 20  # about five days; a closed file is compressed
ROOM_BYTES: Final = 100_000_000  # more than a year
MAX_QUEUED_TICKS: Final = 4096  # ticks with rows: more than two days without a disk


class ThinFile:
    """Appends rows to the newest thin log on the writer's thread; after an error it retries."""

    def __init__(self, logs: Path, head: bytes) -> None:
        """Write below the log directory; `head` is the start of each file."""
        self._directory = logs / THIN
        self._head = head
        self._waiting: deque[bytes] = deque()
        self._disk = LocalDisk()
        self._descriptor = -1
        self._size = 0
        self.lost = 0
        self.failure = ""

    def put(self, rows: bytes) -> None:
        """Queue the rows of a tick on the loop's thread; beyond MAX_QUEUED_TICKS they are dropped and counted."""
        if len(self._waiting) < MAX_QUEUED_TICKS:
            self._waiting.append(rows)
        else:
            self.lost += 1

    def drain(self) -> None:
        """Write and sync the queued rows; store an error as text."""
        if not self._waiting:
            return
        count = len(self._waiting)
        data = b"".join(self._waiting[index] for index in range(count))
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
        """Continue the newest file if this version wrote it and it is not full, otherwise create one.

        A record truncated by a power cut is removed; joined with the next one it would form a wrong record.
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
                self._disk.remove(path)  # otherwise each retry would leave a file
            raise

    def _newest(self) -> Path | None:
        files = log_files(self._directory) if self._directory.is_dir() else {}
        newest = files[max(files)] if files else None
        return newest if newest is not None and newest.suffix == ".BIN" else None

    def _append(self, data: bytes) -> None:
        """Append and sync all data; on OSError truncate the file to its old length."""
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
