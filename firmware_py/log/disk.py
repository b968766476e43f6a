"""The directory of numbered log files: the only place where the log touches the disk."""

from __future__ import annotations

import contextlib
import errno
import os
import re
from pathlib import Path
from typing import Protocol

from firmware_py.files.making import DIRECTORY_MODE, FILE_MODE

NAME = re.compile(r"(\d{8,})\.BIN")


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
        """Remove the oldest files until the rest takes no more than room_bytes."""

    def free_bytes(self, directory: Path) -> int:
        """Return how much room there is for the likes of us."""


class LocalDisk:
    """A Disk of the operating system's."""

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
        _sync_directory(directory)  # else the file itself may be missing after a power cut
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
        """Remove the oldest."""
        files = log_files(directory) if directory.is_dir() else {}
        sizes = {number: path.stat().st_size for number, path in files.items()}
        total = sum(sizes.values())
        for number in sorted(files):
            if total <= room_bytes:
                return
            files[number].unlink()
            total -= sizes[number]

    def free_bytes(self, directory: Path) -> int:
        """Ask the file system; one that is not there yet is its parent's."""
        found = os.statvfs(directory if directory.is_dir() else directory.parent)
        return found.f_bavail * found.f_frsize


def log_files(directory: Path) -> dict[int, Path]:
    """Return the log files of a directory by number; OSError when it cannot be read.

    Links, pipes and whatever else is no file are none of ours, whatever their names.
    """
    with os.scandir(directory) as entries:
        matches = [(NAME.fullmatch(entry.name), entry) for entry in entries]
        return {
            int(match[1]): directory / entry.name
            for match, entry in matches
            if match is not None and entry.is_file(follow_symlinks=False)
        }


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
