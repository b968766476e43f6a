"""Opens a log for reading, compressed or not, as a memory-mapped file."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

from firmware_py.files.packed import MEMBER_BEGIN, packed_path
from firmware_py.files.reading import open_regular
from firmware_py.log.dataflash import Buffer

MAX_LOG_BYTES: Final = 2 << 30  # uncompressed: twice the maximum of LOG_FILE_MB
_GZIP: Final = b"\x1f\x8b"
_CHUNK_BYTES: Final = 1 << 20
_NO_ROOM: Final = "no room for temporary files to unpack it (TMPDIR can name another directory)"


@contextlib.contextmanager
def open_buffer(path: Path) -> Iterator[Buffer]:
    """Map a log, or its compressed file if it has been archived. Raises OSError with a reason in strerror.

    A compressed log is unpacked into a temporary file. A truncated log is read up to its end; damaged blocks are
    skipped.
    """
    try:
        file = os.fdopen(open_regular(path, max_bytes=MAX_LOG_BYTES), "rb")
    except FileNotFoundError:
        if not packed_path(path).is_file():
            raise
        file = os.fdopen(open_regular(packed_path(path), max_bytes=MAX_LOG_BYTES), "rb")
    with contextlib.ExitStack() as resources:
        log: IO[bytes] = resources.enter_context(file)
        if file.peek(len(_GZIP))[: len(_GZIP)] == _GZIP:
            log = resources.enter_context(_open_temporary_file())
            _unpack_members(file, log)
        if not log.seek(0, os.SEEK_END):
            yield b""  # an empty file cannot be mapped
            return
        yield resources.enter_context(mmap.mmap(log.fileno(), 0, access=mmap.ACCESS_READ))


def _open_temporary_file() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(prefix="rambler-")
    except FileNotFoundError as error:  # no temporary directory is writable
        raise OSError(errno.ENOSPC, _NO_ROOM) from error


def _unpack_members(source: IO[bytes], target: IO[bytes]) -> None:
    """Unpack all gzip members. After a damaged member, continue with the next one that `archive_log` wrote."""
    unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
    unpacked_bytes, data = 0, b""
    while data or (data := source.read(_CHUNK_BYTES)):
        try:
            block = unpacker.decompress(data, _CHUNK_BYTES)
        except zlib.error:
            data, unpacker = _find_next_member(data, source), zlib.decompressobj(zlib.MAX_WBITS | 16)
            continue
        unpacked_bytes += len(block)
        if unpacked_bytes > MAX_LOG_BYTES:
            raise OSError(errno.EFBIG, f"unpacks to more than {MAX_LOG_BYTES >> 20} MiB")
        with _remedy_for_full_disk():
            target.write(block)
        if unpacker.eof:
            data = unpacker.unused_data
            unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
        else:
            data = unpacker.unconsumed_tail
    with _remedy_for_full_disk():
        target.flush()


@contextlib.contextmanager
def _remedy_for_full_disk() -> Iterator[None]:
    """Add the remedy to the error for a full disk."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, _NO_ROOM if error.errno == errno.ENOSPC else error.strerror) from error


def _find_next_member(data: bytes, source: IO[bytes]) -> bytes:
    """Search the next member after the first byte; return the data from it on, empty at the end of the source."""
    begin = data.find(MEMBER_BEGIN, 1)
    if begin >= 0:
        return data[begin:]
    for chunk in iter(lambda: source.read(_CHUNK_BYTES), b""):
        data = data[1:][-len(MEMBER_BEGIN) :] + chunk
        if (begin := data.find(MEMBER_BEGIN)) >= 0:
            return data[begin:]
    return b""
