"""The directories of numbered log files: where the log touches the disk.

`00000001.BIN` is a log as it is written, `00000001.BIN.gz` one that was closed and compressed since. Beside the full
logs stand the thin ones, in `thin`, and the last minutes before restarts and severe faults, in `boxes`.
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
from firmware_py.files.making import DIRECTORY_MODE, FILE_MODE, sync_directory
from firmware_py.files.packed import SUFFIX, packed_path

NAME = re.compile(r"([0-9]{8,15})\.BIN(\.gz)?")  # a longer number is not ours, and its next one no name of a file
_BOX_NAME = re.compile(r"([0-9]{8,15})-(end|[0-9]{1,15})\.")  # of black_box.box_path
THIN: Final = "thin"
BOXES: Final = "boxes"
DAY_S: Final = 86_400.0
BOX_SHARE: Final = 0.25  # of the room of all logs: what the boxes may take of it while there are others
MOST_BOXES: Final = 200
SPARE_FILES: Final = 8  # that the disk can still make, where it counts them: a log, what is made of one, the state
_PART: Final = ".part"


class Disk(Protocol):
    """What the writer asks of the disk; every method raises OSError when it cannot."""

    def create(self, directory: Path) -> tuple[int, Path]:
        """Open a new file with the next free number; nothing is ever overwritten."""

    def write(self, descriptor: int, data: memoryview) -> int:
        """Append data or a part of it; return how much."""

    def sync(self, descriptor: int) -> None:
        """Bring what is written to the medium; OSError too when the file has been removed meanwhile."""

    def close(self, descriptor: int) -> None:
        """Close the file."""

    def remove(self, path: Path) -> None:
        """Remove a file."""

    def prune(self, directory: Path, room_bytes: int) -> None:
        """Remove logs until the rest takes no more than room_bytes."""

    def free_bytes(self, directory: Path) -> int:
        """Return how much room there is for the likes of us."""


class LocalDisk:
    """A Disk of the operating system's."""

    def __init__(self, kept_days: float = 0.0, utc_s: Callable[[], float] = time.time, *, spare_bytes: int = 0) -> None:
        """Keep full logs for so many days, 0 for as long as there is room; with `spare_bytes` so many free, and files.

        Days are by the clock that times of files are of, or by the newest log, whichever says an earlier day.
        """
        self._kept_days = kept_days
        self._spare_bytes = spare_bytes
        self._utc_s = utc_s

    def create(self, directory: Path) -> tuple[int, Path]:
        """Open the next file, making the directory (not its parents: they may be a medium that is gone)."""
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
            sync_directory(directory)  # else the file itself may be missing after a power cut
        except OSError:  # each try would leave one, and no descriptor for anything else in the end
            os.close(descriptor)
            with contextlib.suppress(OSError):
                path.unlink()
            raise
        return descriptor, path

    def write(self, descriptor: int, data: memoryview) -> int:
        """Append."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """Bring to the medium; ENOENT when the file has no name any more."""
        os.fdatasync(descriptor)
        if os.fstat(descriptor).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the log file was removed")

    def close(self, descriptor: int) -> None:
        """Close."""
        os.close(descriptor)

    def remove(self, path: Path) -> None:
        """Remove."""
        path.unlink()

    def prune(self, directory: Path, room_bytes: int) -> None:
        """Remove boxes beyond their share, then the oldest logs by age and by room, and boxes if need be.

        The room is less on a disk that would be fuller than it may be, of bytes or of files; where removing every log
        would not free enough, it is somebody else who fills it, and none is removed for that.
        """
        if not directory.is_dir():
            return
        logs = [_Kept.of(path) for _, path in sorted(log_files(directory).items())]
        boxes = [_Kept.of(path) for path in sorted(_box_files(directory), key=_moment)]
        total = sum(kept.size for kept in (*logs, *boxes)) + _unfinished_bytes(directory)
        if self._spare_bytes and (left_bytes := total + self.free_bytes(directory) - self._spare_bytes) > 0:
            room_bytes = min(room_bytes, left_bytes)
        while boxes and (len(boxes) > MOST_BOXES or sum(box.size for box in boxes) > BOX_SHARE * room_bytes):
            total -= _remove(boxes.pop(_densest(boxes)))
        if self._kept_days > 0.0 and is_possible(now_s := self._utc_s()):
            # A log of a clock that was wrong has no age, and a clock that runs years ahead would leave none.
            dated = [kept for kept in logs if is_possible(kept.modified_s)]
            newest_s = max((kept.modified_s for kept in dated), default=now_s)
            oldest_s = min(now_s, newest_s) - self._kept_days * DAY_S
            for kept in [kept for kept in dated if kept.modified_s < oldest_s]:
                total -= _remove(kept)
                logs.remove(kept)
        rest = [*logs, *boxes]
        missing = SPARE_FILES - self.free_files(directory) if self._spare_bytes else 0
        least_removed = missing if missing <= len(rest) else 0
        for removed, kept in enumerate(rest):
            if total <= room_bytes and removed >= least_removed:
                return
            total -= _remove(kept)

    def free_files(self, directory: Path) -> int:
        """Return how many files can be made; as many as are to be spare on a file system that does not count them."""
        found = os.statvfs(directory)
        return found.f_favail if found.f_files else SPARE_FILES

    def free_bytes(self, directory: Path) -> int:
        """Ask the file system; one that is not there yet is its parent's."""
        found = os.statvfs(directory if directory.is_dir() else directory.parent)
        return found.f_bavail * found.f_frsize


def log_files(directory: Path) -> dict[int, Path]:
    """Return the log files of a directory by number; OSError when it cannot be read.

    Of a log that is there compressed and not, between two steps of compressing it, that is named which is not.
    Links, pipes and whatever else is no file are none of ours, whatever their names.
    """
    found: dict[int, Path] = {}
    for name in _file_names(directory):
        match = NAME.fullmatch(name)
        if match is not None and (match[2] is None or int(match[1]) not in found):
            found[int(match[1])] = directory / name
    return found


def last_written_s(directory: Path) -> float:
    """Return when the newest log of any kind was written, by the clock of then; 0 when there is none or no telling."""
    times_s = [0.0]
    with contextlib.suppress(OSError):
        for kind in ("", THIN):
            if (directory / kind).is_dir():
                times_s += (path.stat().st_mtime for path in log_files(directory / kind).values())
    return max(times_s)


def part_path(path: Path) -> Path:
    """Return where a file is made before it is whole; stations do not see such names."""
    return path.with_name(f".{path.name}{_PART}")


class _Kept(msgspec.Struct, frozen=True):
    path: Path
    size: int
    modified_s: float

    @classmethod
    def of(cls, path: Path) -> _Kept:
        status = path.stat()
        return cls(path, status.st_size, status.st_mtime)


def _remove(kept: _Kept) -> int:
    """Remove a log, and what an interrupted step of compressing it has left; return its size."""
    size, part = kept.size, part_path(packed_path(kept.path))
    with contextlib.suppress(FileNotFoundError):
        size += part.stat().st_size
        part.unlink()
    kept.path.unlink()
    return size


def _densest(boxes: list[_Kept]) -> int:
    """Return which of boxes, in their order, is closest in time to the one before; never the newest of several.

    So a boat that restarts again and again thins out the boxes of that, not those of months.
    """
    pairs = enumerate(pairwise(boxes), 1)
    gaps = [(abs(after.modified_s - before.modified_s), place) for place, (before, after) in pairs]
    return min(gaps[:-1], default=(0.0, 0))[1]


def _moment(box: Path) -> tuple[int, float, str]:
    """Return what boxes are in order of: log and moment, for a computer may have begun at 1970 with each start."""
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
