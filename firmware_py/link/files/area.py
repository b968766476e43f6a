"""A directory of the disk as ground stations may see it: never outside it, whatever the name.

Every step of a path is opened relative to the one before and without following symbolic links, so that neither
dots nor links nor a directory swapped meanwhile lead out.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from firmware_py.files.packed import SUFFIX, PackedFile, PlainFile
from firmware_py.files.writing import DIRECTORY_MODE, FILE_MODE
from firmware_py.link.files.payload import Error, Refusal

MAX_NAME_LENGTH = 64
MAX_DEPTH = 4
FILE_BYTES = 1 << 20  # the largest file that is taken
AREA_BYTES = 16 << 20
AREA_FILES = 128
_LISTED = 4096
_CHUNK = 1 << 18
_PART = ".part"  # an upload before it is whole

Parts = tuple[str, ...]


class Entry(NamedTuple):
    """One line of a listing."""

    name: str
    directory: bool
    size: int
    modified_s: int  # since 1970


def mavlink_crc32(data: bytes, before: int = 0) -> int:
    """Return MAVLink's CRC-32: as zlib's, but begun with 0 and not inverted at the end."""
    return zlib.crc32(data, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


class Area:
    """One directory; all methods raise OSError or Refusal, and may wait for the disk."""

    def __init__(self, root: Path, *, writable: bool) -> None:
        """Take the directory; a writable one is made when it is first written to."""
        self._root = root
        self.writable = writable

    def listing(self, parts: Parts) -> tuple[Entry, ...]:
        """Return the entries of a directory, by name; hidden names, links and devices are left out."""
        listing: list[Entry] = []
        try:
            with self._directory(parts) as directory, os.scandir(directory) as entries:
                for entry in entries:
                    if entry.name.startswith(".") or len(listing) >= _LISTED:
                        continue
                    status = entry.stat(follow_symlinks=False)
                    if stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode):
                        is_directory = stat.S_ISDIR(status.st_mode)
                        size = 0 if is_directory else status.st_size
                        listing.append(Entry(entry.name, is_directory, size, max(0, int(status.st_mtime))))
        except FileNotFoundError:
            if parts:
                raise
        return tuple(sorted(listing))

    def open_read(self, parts: Parts) -> PlainFile | PackedFile:
        """Open a file; a log that has been compressed since it was listed is read as it was written."""
        with self._directory(parts[:-1]) as directory:
            try:
                return PlainFile(_open_regular(_name(parts), directory))
            except FileNotFoundError:
                if self.writable:
                    raise
                with contextlib.suppress(FileNotFoundError):
                    return PackedFile(_open_regular(_name(parts) + SUFFIX, directory))
                raise

    def read_whole(self, parts: Parts) -> bytes:
        """Return the content of a file that is small enough to be rewritten."""
        with contextlib.closing(self.open_read(parts)) as file:
            if file.size > FILE_BYTES:
                raise OSError(errno.EFBIG, "too large")
            return file.read(0, FILE_BYTES)

    def checksum(self, parts: Parts) -> int:
        """Return MAVLink's CRC-32 of a file."""
        with contextlib.closing(self.open_read(parts)) as file:
            checksum, offset = 0, 0
            while chunk := file.read(offset, _CHUNK):
                checksum = mavlink_crc32(chunk, checksum)
                offset += len(chunk)
        return checksum

    def store(self, parts: Parts, content: bytes) -> None:
        """Write a whole file: on disk under its name, or not at all."""
        self._check_room(parts, len(content))
        with self._directory(parts[:-1]) as directory:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            descriptor = os.open(_PART, flags, FILE_MODE, dir_fd=directory)
            try:
                os.write(descriptor, content)
                os.fsync(descriptor)
                _check_size(descriptor, len(content))
                os.rename(_PART, _name(parts), src_dir_fd=directory, dst_dir_fd=directory)
                os.fsync(directory)
            except OSError:
                with contextlib.suppress(OSError):
                    os.unlink(_PART, dir_fd=directory)
                raise
            finally:
                os.close(descriptor)

    def truncate(self, parts: Parts, size: int) -> None:
        """Cut a file to a size; making it longer is refused."""
        content = self.read_whole(parts)
        if size > len(content):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        self.store(parts, content[:size])

    def remove(self, parts: Parts) -> None:
        """Remove a file."""
        with self._directory(parts[:-1]) as directory:
            try:
                os.unlink(_name(parts), dir_fd=directory)
            except IsADirectoryError:
                raise Refusal(Error.FAIL_ERRNO, errno.EISDIR) from None

    def make_directory(self, parts: Parts) -> None:
        """Make a directory."""
        if len(parts) >= MAX_DEPTH:
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        self._check_room(parts, 0)
        with self._directory(parts[:-1]) as directory:
            os.mkdir(_name(parts), DIRECTORY_MODE, dir_fd=directory)

    def remove_directory(self, parts: Parts) -> None:
        """Remove an empty directory."""
        with self._directory(parts[:-1]) as directory:
            os.rmdir(_name(parts), dir_fd=directory)

    def rename(self, old: Parts, new: Parts) -> None:
        """Give a file or directory another name; FILE_EXISTS when there is one already."""
        with self._directory(old[:-1]) as source, self._directory(new[:-1]) as target:
            os.stat(_name(old), dir_fd=source, follow_symlinks=False)
            with contextlib.suppress(FileNotFoundError):
                os.stat(_name(new), dir_fd=target, follow_symlinks=False)
                raise Refusal(Error.FILE_EXISTS)
            os.rename(_name(old), _name(new), src_dir_fd=source, dst_dir_fd=target)

    @contextlib.contextmanager
    def _directory(self, parts: Parts) -> Iterator[int]:
        if self.writable:
            self._root.mkdir(DIRECTORY_MODE, exist_ok=True)
        descriptor = os.open(self._root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            for name in parts:
                flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
                following = os.open(name, flags, dir_fd=descriptor)
                os.close(descriptor)
                descriptor = following
            yield descriptor
        finally:
            os.close(descriptor)

    def _check_room(self, parts: Parts, more_bytes: int) -> None:
        """Refuse what would make the area larger than it may become."""
        count, total = 0, more_bytes
        waiting: list[Parts] = [()]
        while waiting:
            place = waiting.pop()
            for entry in self.listing(place):
                path = (*place, entry.name)
                count += path != parts
                total += 0 if path == parts else entry.size
                if entry.directory:
                    waiting.append(path)
        if count >= AREA_FILES or total > AREA_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _open_regular(name: str, directory: int) -> int:
    # Without O_NONBLOCK a pipe would be waited for.
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    descriptor = os.open(name, flags, dir_fd=directory)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise Refusal(Error.FILE_PROTECTED)
    return descriptor


def _name(parts: Parts) -> str:
    if not parts:
        raise Refusal(Error.FILE_PROTECTED)  # the area itself
    return parts[-1]


def _check_size(descriptor: int, size: int) -> None:
    """Find out whether all has been written: a full disk takes a part."""
    if os.fstat(descriptor).st_size != size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
