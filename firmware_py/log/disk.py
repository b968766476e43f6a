"""Directories of numbered log files: creating, listing and pruning.

`00000001.BIN` is an uncompressed log, `00000001.BIN.gz` a closed and compressed one. The subdirectory `thin` contains
the thin logs, `boxes` the black boxes: the last minutes before restarts and severe faults.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import time
from collections.abc import Callable
from itertools import count, pairwise
from pathlib import Path
from typing import Final, Protocol

import msgspec

from firmware_py.common.calendar import is_possible
from firmware_py.files.packed import SUFFIX, packed_path
from firmware_py.files.writing import DIRECTORY_MODE, FILE_MODE, sync_directory

LOG_NAME = re.compile(r"([0-9]{8,15})\.BIN(\.gz)?")  # longer numbers are not from this program
_BOX_NAME = re.compile(r"([0-9]{8,15})-(end|[0-9]{1,15})\.")  # as black_box.box_path builds it
THIN: Final = "thin"
BOXES: Final = "boxes"
DAY_S: Final = 86_400.0
MAX_BOX_FRACTION: Final = 0.25  # of the space of all logs
MAX_BOXES: Final = 200
MIN_FREE_FILES: Final = 8  # free inodes for a log, its archive and the state, on file systems that limit them
_PART_SUFFIX: Final = ".part"


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

    def prune(self, directory: Path, max_log_bytes: int) -> None:
        """Remove the oldest logs until the rest has at most `max_log_bytes`."""

    def free_bytes(self, directory: Path) -> int:
        """Return the free space for unprivileged users."""


class LocalDisk:
    """Implementation of Disk by calls of the operating system."""

    def __init__(
        self, retention_days: float = 0.0, utc_s: Callable[[], float] = time.time, *, reserve_bytes: int = 0
    ) -> None:
        """Keep logs for `retention_days` (0: while there is space).

        With `reserve_bytes`, that much space and MIN_FREE_FILES stay free. The age of a log is its distance from the
        clock or from the newest log, whichever is earlier.
        """
        self._retention_days = retention_days
        self._reserve_bytes = reserve_bytes
        self._utc_s = utc_s

    def create(self, directory: Path) -> tuple[int, Path]:
        """Create the next file and if necessary the directory, but not its parents: they may be on a removed medium."""
        with contextlib.suppress(FileExistsError):
            directory.mkdir(DIRECTORY_MODE)
        for number in count(max(log_files(directory), default=0) + 1):
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
        """Write the file to the medium; raise FileNotFoundError if it was removed."""
        os.fdatasync(descriptor)
        if os.fstat(descriptor).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the log file was removed")

    def close(self, descriptor: int) -> None:
        """Close the file."""
        os.close(descriptor)

    def remove(self, path: Path) -> None:
        """Remove a file."""
        path.unlink()

    def prune(self, directory: Path, max_log_bytes: int) -> None:
        """Remove boxes beyond their fraction, then the oldest logs by age and by space, and boxes if still necessary.

        If the reserve of space or files is not free, more is removed than `max_log_bytes` requires. If removing every
        log would not restore the reserve, other files fill the disk, and no log is removed for it.
        """
        if not directory.is_dir():
            return
        logs = [_FileStatus.read(path) for _, path in sorted(log_files(directory).items())]
        boxes = [_FileStatus.read(path) for path in sorted(_list_boxes(directory), key=_event_key)]
        total_bytes = sum(log_file.size for log_file in (*logs, *boxes)) + _partial_archive_bytes(directory)
        if (usable_bytes := total_bytes + self.free_bytes(directory) - self._reserve_bytes) > 0:
            max_log_bytes = min(max_log_bytes, usable_bytes)
        while len(boxes) > MAX_BOXES or sum(box.size for box in boxes) > MAX_BOX_FRACTION * max_log_bytes:
            total_bytes -= _remove(boxes.pop(_index_of_densest(boxes)))
        if self._retention_days > 0.0 and is_possible(now_s := self._utc_s()):
            # Logs with an impossible time have no age. Ages count from the newest log at the latest, so that a clock
            # that is years ahead does not delete all logs.
            dated_logs = [log_file for log_file in logs if is_possible(log_file.modified_s)]
            newest_s = max((log_file.modified_s for log_file in dated_logs), default=now_s)
            min_time_s = min(now_s, newest_s) - self._retention_days * DAY_S
            for log_file in [log_file for log_file in dated_logs if log_file.modified_s < min_time_s]:
                total_bytes -= _remove(log_file)
                logs.remove(log_file)
        remaining = [*logs, *boxes]
        missing_files = MIN_FREE_FILES - self.free_files(directory) if self._reserve_bytes else 0
        min_removed = missing_files if missing_files <= len(remaining) else 0
        for removed_count, log_file in enumerate(remaining):
            if total_bytes <= max_log_bytes and removed_count >= min_removed:
                return
            total_bytes -= _remove(log_file)

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
        match = LOG_NAME.fullmatch(name)
        if match is not None and (match[2] is None or int(match[1]) not in files):
            files[int(match[1])] = directory / name
    return files


def newest_log_time_s(directory: Path) -> float:
    """Return the modification time of the newest log of any kind, 0 if there is none or it cannot be read."""
    times_s = [0.0]
    with contextlib.suppress(OSError):
        for kind in ("", THIN):
            if (directory / kind).is_dir():
                times_s += (path.stat().st_mtime for path in log_files(directory / kind).values())
    return max(times_s)


def partial_path(path: Path) -> Path:
    """Return the path of a file until it is complete; MAVLink FTP does not list such names."""
    return path.with_name(f".{path.name}{_PART_SUFFIX}")


class _FileStatus(msgspec.Struct, frozen=True):
    path: Path
    size: int
    modified_s: float

    @classmethod
    def read(cls, path: Path) -> _FileStatus:
        status = path.stat()
        return cls(path, status.st_size, status.st_mtime)


def _remove(log_file: _FileStatus) -> int:
    """Remove a log and a partial archive of it; return the freed size."""
    size, partial_archive = log_file.size, partial_path(packed_path(log_file.path))
    with contextlib.suppress(FileNotFoundError):
        size += partial_archive.stat().st_size
        partial_archive.unlink()
    log_file.path.unlink()
    return size


def _index_of_densest(boxes: list[_FileStatus]) -> int:
    """Return the index of the box that is closest in time to its predecessor; the newest box is never selected.

    Of one or two boxes it is the first.

    After many restarts in succession, this selects boxes of those restarts and not those of earlier months.
    """
    pairs = enumerate(pairwise(boxes), 1)
    gaps = [(abs(next_box.modified_s - box.modified_s), index) for index, (box, next_box) in pairs]
    return min(gaps[:-1])[1] if gaps[1:] else 0


def _event_key(box: Path) -> tuple[int, float, str]:
    """Return the sort key of a box: log number and time of the event; file times depend on the calendar clock."""
    match = _BOX_NAME.match(box.name)
    if match is None:
        return 0, 0.0, box.name
    return int(match[1]), float("inf") if match[2] == "end" else float(match[2]), box.name


def _list_boxes(directory: Path) -> list[Path]:
    boxes = directory / BOXES
    return [boxes / name for name in _file_names(boxes) if name.endswith(SUFFIX)] if boxes.is_dir() else []


def _partial_archive_bytes(directory: Path) -> int:
    parts = [directory / name for name in _file_names(directory) if name.endswith(_PART_SUFFIX)]
    return sum(path.stat().st_size for path in parts)


def _file_names(directory: Path) -> list[str]:
    with os.scandir(directory) as entries:
        return sorted(entry.name for entry in entries if entry.is_file(follow_symlinks=False))
