"""Writes the thin log. Rows stay queued until they are on disk; each start of the program continues the newest file."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from pathlib import Path
from typing import Final

from firmware_py.files.reading import open_regular
from firmware_py.files.writing import DIRECTORY_MODE
from firmware_py.log.dataflash import size_of_whole_records
from firmware_py.log.disk import THIN, LocalDisk, log_files

MAX_FILE_BYTES: Final = 1 << 20  # about five days; a closed file is compressed
MAX_TOTAL_BYTES: Final = 100_000_000  # more than a year
MAX_QUEUED_TICKS: Final = 4096  # more than two days without a disk


class ThinFile:
    """Appends rows to the newest thin log.

    `put` is called on the loop's thread, the other methods on the writer's thread. `lost` is the number of dropped
    ticks, `failure` the text of the last error, empty after a success.
    """

    def __init__(self, logs: Path, file_head: bytes) -> None:
        """Store the log directory and the bytes with which each file starts."""
        self._directory = logs / THIN
        self._file_head = file_head
        self._queue: deque[bytes] = deque()
        self._disk = LocalDisk()
        self._descriptor = -1
        self._size = 0
        self.lost = 0
        self.failure = ""

    def put(self, rows: bytes) -> None:
        """Queue the rows of a tick; drop and count them if MAX_QUEUED_TICKS are queued."""
        if len(self._queue) < MAX_QUEUED_TICKS:
            self._queue.append(rows)
        else:
            self.lost += 1

    def drain(self) -> None:
        """Write and sync the queued rows. After an error they stay queued for the next call."""
        if not self._queue:
            return
        count = len(self._queue)
        data = b"".join(self._queue[index] for index in range(count))
        try:
            if self._size >= MAX_FILE_BYTES:
                self.close()
            if self._descriptor < 0:
                self._open()
            self._append(data)
        except OSError as error:
            self.failure = f"thin log: {error.strerror or error}"
            self.close()
            return
        for _ in range(count):
            self._queue.popleft()
        self.failure = ""

    def close(self) -> None:
        """Close the file."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1

    def _open(self) -> None:
        """Continue the newest file if this version wrote it and it is not full, otherwise create a file.

        A record truncated by a power cut is removed, because the parser would combine it with the next record.
        """
        newest = self._find_newest()
        if newest is not None:
            self._descriptor = open_regular(newest, flags=os.O_RDWR | os.O_APPEND, follow_symlinks=False)
            content = os.pread(self._descriptor, MAX_FILE_BYTES, 0)
            if len(content) < MAX_FILE_BYTES and content.startswith(self._file_head):
                self._size = size_of_whole_records(content)
                if self._size < len(content):
                    os.ftruncate(self._descriptor, self._size)
                return
            self.close()
        with contextlib.suppress(FileExistsError):
            self._directory.parent.mkdir(DIRECTORY_MODE)
        self._disk.prune(self._directory, MAX_TOTAL_BYTES - MAX_FILE_BYTES)
        self._descriptor, path = self._disk.create(self._directory)
        self._size = 0
        try:
            self._append(self._file_head)
        except OSError:
            with contextlib.suppress(OSError):
                self._disk.remove(path)  # otherwise each retry would leave a file
            raise

    def _find_newest(self) -> Path | None:
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
