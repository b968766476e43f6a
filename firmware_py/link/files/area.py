"""Access of ground stations to one directory of the disk, and to nothing outside it.

Each directory of a path is opened relative to its parent and without following symbolic links. A path with dots or
links, or a directory that is replaced during the access, therefore gives no access to other directories.
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
MAX_DEPTH = 4  # components of a path in an area
MAX_FILE_BYTES = 1 << 20
MAX_AREA_BYTES = 16 << 20
MAX_AREA_FILES = 128  # with the directories
_MAX_ENTRIES = 4096  # of a listing
_CHUNK_BYTES = 1 << 18
_PARTIAL_NAME = ".part"  # name of an incomplete upload

PathParts = tuple[str, ...]  # relative to a root; the root itself is empty


class Entry(NamedTuple):
    """One line of a listing."""

    name: str
    is_directory: bool
    size: int
    modified_s: int  # since 1970


def mavlink_crc32(data: bytes, previous: int = 0) -> int:
    """Return MAVLink's CRC-32: as zlib's, but with initial value 0 and no final inversion."""
    return zlib.crc32(data, previous ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


class Area:
    """One directory; all methods raise OSError or Refusal, and may block on the disk."""

    def __init__(self, root: Path, *, writable: bool) -> None:
        """Store the path; a writable directory is created on first access."""
        self._root = root
        self.writable = writable

    def list_directory(self, parts: PathParts) -> tuple[Entry, ...]:
        """Return the entries of a directory sorted by name, without hidden files, links and devices."""
        entries: list[Entry] = []
        try:
            with self._open_directory(parts) as directory, os.scandir(directory) as scan:
                for entry in scan:
                    if entry.name.startswith(".") or len(entries) >= _MAX_ENTRIES:
                        continue
                    status = entry.stat(follow_symlinks=False)
                    if stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode):
                        is_directory = stat.S_ISDIR(status.st_mode)
                        size = 0 if is_directory else status.st_size
                        entries.append(Entry(entry.name, is_directory, size, max(0, int(status.st_mtime))))
        except FileNotFoundError:
            if parts:
                raise
        return tuple(sorted(entries))

    def open_read(self, parts: PathParts) -> PlainFile | PackedFile:
        """Open a file; a log that was compressed after it was listed is decompressed."""
        with self._open_directory(parts[:-1]) as directory:
            try:
                return PlainFile(_open_regular(_file_name(parts), directory))
            except FileNotFoundError:
                if self.writable:
                    raise
                with contextlib.suppress(FileNotFoundError):
                    return PackedFile(_open_regular(_file_name(parts) + SUFFIX, directory))
                raise

    def read_whole(self, parts: PathParts) -> bytes:
        """Return the content of a file; raise OSError if it is larger than MAX_FILE_BYTES."""
        with contextlib.closing(self.open_read(parts)) as file:
            if file.size > MAX_FILE_BYTES:
                raise OSError(errno.EFBIG, "too large")
            return file.read(0, MAX_FILE_BYTES)

    def checksum(self, parts: PathParts) -> int:
        """Return MAVLink's CRC-32 of a file."""
        with contextlib.closing(self.open_read(parts)) as file:
            checksum, offset = 0, 0
            while chunk := file.read(offset, _CHUNK_BYTES):
                checksum = mavlink_crc32(chunk, checksum)
                offset += len(chunk)
        return checksum

    def store(self, parts: PathParts, content: bytes) -> None:
        """Write a file atomically."""
        self._check_quota(parts, len(content))
        with self._open_directory(parts[:-1]) as directory:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            descriptor = os.open(_PARTIAL_NAME, flags, FILE_MODE, dir_fd=directory)
            try:
                os.write(descriptor, content)
                os.fsync(descriptor)
                _check_size(descriptor, len(content))
                os.rename(_PARTIAL_NAME, _file_name(parts), src_dir_fd=directory, dst_dir_fd=directory)
                os.fsync(directory)
            except OSError:
                with contextlib.suppress(OSError):
                    os.unlink(_PARTIAL_NAME, dir_fd=directory)
                raise
            finally:
                os.close(descriptor)

    def truncate(self, parts: PathParts, size: int) -> None:
        """Truncate a file to a size; raise OSError if the file is shorter."""
        content = self.read_whole(parts)
        if size > len(content):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        self.store(parts, content[:size])

    def remove(self, parts: PathParts) -> None:
        """Remove a file."""
        with self._open_directory(parts[:-1]) as directory:
            try:
                os.unlink(_file_name(parts), dir_fd=directory)
            except IsADirectoryError:
                raise Refusal(Error.FAIL_ERRNO, errno.EISDIR) from None

    def make_directory(self, parts: PathParts) -> None:
        """Create a directory."""
        if len(parts) >= MAX_DEPTH:
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        self._check_quota(parts, 0)
        with self._open_directory(parts[:-1]) as directory:
            os.mkdir(_file_name(parts), DIRECTORY_MODE, dir_fd=directory)

    def remove_directory(self, parts: PathParts) -> None:
        """Remove an empty directory."""
        with self._open_directory(parts[:-1]) as directory:
            os.rmdir(_file_name(parts), dir_fd=directory)

    def rename(self, old: PathParts, new: PathParts) -> None:
        """Rename a file or directory; raise Refusal with FILE_EXISTS if the new name exists."""
        with self._open_directory(old[:-1]) as source, self._open_directory(new[:-1]) as target:
            os.stat(_file_name(old), dir_fd=source, follow_symlinks=False)
            with contextlib.suppress(FileNotFoundError):
                os.stat(_file_name(new), dir_fd=target, follow_symlinks=False)
                raise Refusal(Error.FILE_EXISTS)
            os.rename(_file_name(old), _file_name(new), src_dir_fd=source, dst_dir_fd=target)

    @contextlib.contextmanager
    def _open_directory(self, parts: PathParts) -> Iterator[int]:
        """Open a directory and yield its descriptor."""
        if self.writable:
            self._root.mkdir(DIRECTORY_MODE, exist_ok=True)
        descriptor = os.open(self._root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            for name in parts:
                flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
                child = os.open(name, flags, dir_fd=descriptor)
                os.close(descriptor)
                descriptor = child
            yield descriptor
        finally:
            os.close(descriptor)

    def _check_quota(self, parts: PathParts, added_bytes: int) -> None:
        """Raise OSError if the area would exceed its maximum size or number of files and directories."""
        count, total = 0, added_bytes
        pending: list[PathParts] = [()]
        while pending:
            directory = pending.pop()
            for entry in self.list_directory(directory):
                path = (*directory, entry.name)
                count += path != parts
                total += 0 if path == parts else entry.size
                if entry.is_directory:
                    pending.append(path)
        if count >= MAX_AREA_FILES or total > MAX_AREA_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _open_regular(name: str, directory: int) -> int:
    """Return a descriptor for reading; raise Refusal with FILE_PROTECTED unless it is a regular file."""
    # Without O_NONBLOCK, opening a pipe blocks.
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    descriptor = os.open(name, flags, dir_fd=directory)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise Refusal(Error.FILE_PROTECTED)
    return descriptor


def _file_name(parts: PathParts) -> str:
    """Return the last component of a path; raise Refusal for the area itself."""
    if not parts:
        raise Refusal(Error.FILE_PROTECTED)
    return parts[-1]


def _check_size(descriptor: int, size: int) -> None:
    """Raise OSError if the file is incomplete, as on a full disk."""
    if os.fstat(descriptor).st_size != size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
