"""The directories of numbered log files: all disk access of the log.

`00000001.BIN` is a log as it is written, `00000001.BIN.gz` a closed and compressed one. The subdirectory `thin` holds
the thin logs, `boxes` the black boxes: the last minutes before restarts and severe faults.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Final, Protocol

import msgspec

from firmware_py.common.calendar import is_possible
from firmware_py.files.packed import SUFFIX, packed_path
from firmware_py.files.writing import DIRECTORY_MODE, FILE_MODE, sync_directory

NAME = re.compile(r"([0-9]{8,15})\.BIN(\.gz)?")  # a file with a longer number is not a log of this program
_BOX_NAME = re.compile(r"([0-9]{8,15})-(end|[0-9]{1,15})\.")  # of black_box.box_path
THIN: Final = "thin"
BOXES: Final = "boxes"
DAY_S: Final = 86_400.0
MAX_BOX_SHARE: Final = 0.25  # of the space of all logs
MAX_BOXES: Final = 200
MIN_FREE_FILES: Final = 8  # free inodes for a log, its archive and the state, on file systems that limit them
_PART: Final = ".part"


class Disk(Protocol):
    """Disk operations of the writer; every method raises OSError on failure."""

    def create(self, directory: Path) -> tuple[int, Path]:
        """Open a new file with the next free number; no file is overwritten."""

    def write(self, descriptor: int, data: memoryview) -> int:
        """Append data or a part of it; return the number of bytes."""

    def sync(self, descriptor: int) -> None:
        """Write the file to the medium; raises OSError also if the file was removed."""

    def close(self, descriptor: int) -> None:
        """Close the file."""

    def remove(self, path: Path) -> None:
        """Remove a file."""

    def prune(self, directory: Path, room_bytes: int) -> None:
        """Remove logs until the rest takes at most room_bytes."""

    def free_bytes(self, directory: Path) -> int:
        """Return the free space for unprivileged users."""


class LocalDisk:
    """A Disk of the operating system."""

    def __init__(
        self, retention_days: float = 0.0, utc_s: Callable[[], float] = time.time, *, reserve_bytes: int = 0
    ) -> None:
        """Store full logs for `retention_days` (0: while there is space).

        With `reserve_bytes`, that much space and MIN_FREE_FILES stay free. Ages count from the clock or from the
        newest log, whichever is earlier.
        """
        self._retention_days = retention_days
        self._reserve_bytes = reserve_bytes
        self._utc_s = utc_s

    def create(self, directory: Path) -> tuple[int, Path]:
        """Open the next file; create the directory, but not its parents, which may be a removed medium."""
        with contextlib.suppress(FileExistsError):
            directory.mkdir(DIRECTORY_MODE)
        number = max(log_files(directory), default=0)
        while True:
            number += 1
            path = directory / f"{number:08d}.BIN"
            with contextlib.suppress(FileExistsError):
                descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, FILE_MODE)
                break
        try:
            sync_directory(directory)  # otherwise the file may be missing after a power cut
        except OSError:  # otherwise each retry would leave an open file
            os.close(descriptor)
            with contextlib.suppress(OSError):
                path.unlink()
            raise
        return descriptor, path

    def write(self, descriptor: int, data: memoryview) -> int:
        """Append data."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """Write the file to the medium; ENOENT if it was removed."""
        os.fdatasync(descriptor)
        if os.fstat(descriptor).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the log file was removed")

    def close(self, descriptor: int) -> None:
        """Close the file."""
        os.close(descriptor)

    def remove(self, path: Path) -> None:
        """Remove a file."""
        path.unlink()

    def prune(self, directory: Path, room_bytes: int) -> None:
        """Remove boxes beyond their share, then the oldest logs by age and by space, and boxes if still necessary.

        Less than `room_bytes` is available if the reserve of space or files is not free. If removing every log would
        not restore the reserve, other files fill the disk, and no log is removed for it.
        """
        if not directory.is_dir():
            return
        logs = [_LogFile.of(path) for _, path in sorted(log_files(directory).items())]
        boxes = [_LogFile.of(path) for path in sorted(_box_files(directory), key=_moment)]
        total = sum(log_file.size for log_file in (*logs, *boxes)) + _unfinished_bytes(directory)
        if self._reserve_bytes and (left_bytes := total + self.free_bytes(directory) - self._reserve_bytes) > 0:
            room_bytes = min(room_bytes, left_bytes)
        while boxes and (len(boxes) > MAX_BOXES or sum(box.size for box in boxes) > MAX_BOX_SHARE * room_bytes):
            total -= _remove(boxes.pop(_densest(boxes)))
        if self._retention_days > 0.0 and is_possible(now_s := self._utc_s()):
            # A log written with a wrong clock has no age; a clock that is years ahead must not delete all logs.
            dated = [log_file for log_file in logs if is_possible(log_file.modified_s)]
            newest_s = max((log_file.modified_s for log_file in dated), default=now_s)
            oldest_s = min(now_s, newest_s) - self._retention_days * DAY_S
            for log_file in [log_file for log_file in dated if log_file.modified_s < oldest_s]:
                total -= _remove(log_file)
                logs.remove(log_file)
        rest = [*logs, *boxes]
        missing = MIN_FREE_FILES - self.free_files(directory) if self._reserve_bytes else 0
        min_removed = missing if missing <= len(rest) else 0
        for removed, log_file in enumerate(rest):
            if total <= room_bytes and removed >= min_removed:
                return
            total -= _remove(log_file)

    def free_files(self, directory: Path) -> int:
        """Return the number of free inodes, MIN_FREE_FILES on a file system that does not limit them."""
        usage = os.statvfs(directory)
        return usage.f_favail if usage.f_files else MIN_FREE_FILES

    def free_bytes(self, directory: Path) -> int:
        """Return the free space of the directory's file system, or of its parent's if it does not exist."""
        usage = os.statvfs(directory if directory.is_dir() else directory.parent)
        return usage.f_bavail * usage.f_frsize


def log_files(directory: Path) -> dict[int, Path]:
    """Return the log files of a directory by number; raises OSError.

    If a log exists both compressed and uncompressed, as during compression, the uncompressed one is returned.
    Entries that are not regular files are ignored.
    """
    files: dict[int, Path] = {}
    for name in _file_names(directory):
        match = NAME.fullmatch(name)
        if match is not None and (match[2] is None or int(match[1]) not in files):
            files[int(match[1])] = directory / name
    return files


def last_written_s(directory: Path) -> float:
    """Return the modification time of the newest log of any kind, 0 if there is none or it cannot be read."""
    times_s = [0.0]
    with contextlib.suppress(OSError):
        for kind in ("", THIN):
            if (directory / kind).is_dir():
                times_s += (path.stat().st_mtime for path in log_files(directory / kind).values())
    return max(times_s)


def part_path(path: Path) -> Path:
    """Return the path of a file under construction; the link does not list such names."""
    return path.with_name(f".{path.name}{_PART}")


class _LogFile(msgspec.Struct, frozen=True):
    path: Path
    size: int
    modified_s: float

    @classmethod
    def of(cls, path: Path) -> _LogFile:
        status = path.stat()
        return cls(path, status.st_size, status.st_mtime)


def _remove(log_file: _LogFile) -> int:
    """Remove a log and a partial archive of it; return the freed size."""
    size, part = log_file.size, part_path(packed_path(log_file.path))
    with contextlib.suppress(FileNotFoundError):
        size += part.stat().st_size
        part.unlink()
    log_file.path.unlink()
    return size


def _densest(boxes: list[_LogFile]) -> int:
    """Return the index of the box that is closest in time to its predecessor; never the newest of several.

    After many restarts in a row, this removes boxes of those restarts and not those of earlier months.
    """
    pairs = enumerate(pairwise(boxes), 1)
    gaps = [(abs(after.modified_s - before.modified_s), index) for index, (before, after) in pairs]
    return min(gaps[:-1], default=(0.0, 0))[1]


def _moment(box: Path) -> tuple[int, float, str]:
    """Return the sort key of a box: log number and moment; file times are unreliable without a clock."""
    match = _BOX_NAME.match(box.name)
    if match is None:
        return 0, 0.0, box.name
    return int(match[1]), float("inf") if match[2] == "end" else float(match[2]), box.name


def _box_files(directory: Path) -> list[Path]:
    boxes = directory / BOXES
    return [boxes / name for name in _file_names(boxes) if name.endswith(SUFFIX)] if boxes.is_dir() else []


def _unfinished_bytes(directory: Path) -> int:
    parts = [directory / name for name in _file_names(directory) if name.endswith(_PART)]
    return sum(path.stat().st_size for path in parts)


def _file_names(directory: Path) -> list[str]:
    with os.scandir(directory) as entries:
        return sorted(entry.name for entry in entries if entry.is_file(follow_symlinks=False))
