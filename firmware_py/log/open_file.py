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

    A compressed log is unpacked into a temporary file. A truncated one is read up to its end; a
    damaged block is skipped.
    """
    try:
        file = os.fdopen(open_regular(path, max_bytes=MAX_LOG_BYTES), "rb")
    except FileNotFoundError:
        if not packed_path(path).is_file():
            raise
        file = os.fdopen(open_regular(packed_path(path), max_bytes=MAX_LOG_BYTES), "rb")
    with contextlib.ExitStack() as opened:
        plain: IO[bytes] = opened.enter_context(file)
        if file.peek(len(_GZIP))[: len(_GZIP)] == _GZIP:
            plain = opened.enter_context(_temporary_file())
            _unpack(file, plain)
            _put(plain, b"")
        if not plain.seek(0, os.SEEK_END):
            yield b""  # an empty file cannot be mapped
            return
        yield opened.enter_context(mmap.mmap(plain.fileno(), 0, access=mmap.ACCESS_READ))


def _temporary_file() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(prefix="rambler-")
    except FileNotFoundError as error:  # no temporary directory is writable
        raise OSError(errno.ENOSPC, _NO_ROOM) from error


def _put(target: IO[bytes], part: bytes) -> None:
    """Write a part; flush if it is empty."""
    try:
        target.write(part)
        if not part:
            target.flush()
    except OSError as error:
        raise OSError(error.errno, _NO_ROOM if error.errno == errno.ENOSPC else error.strerror) from error


def _unpack(source: IO[bytes], target: IO[bytes]) -> None:
    """Unpack all members; after a damaged one, continue with the next block written by `archive_log`."""
    unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
    size, data = 0, b""
    while data or (data := source.read(_CHUNK_BYTES)):
        try:
            part = unpacker.decompress(data, _CHUNK_BYTES)
        except zlib.error:
            data, unpacker = _next_member(data, source), zlib.decompressobj(zlib.MAX_WBITS | 16)
            continue
        size += len(part)
        if size > MAX_LOG_BYTES:
            raise OSError(errno.EFBIG, f"unpacks to more than {MAX_LOG_BYTES >> 20} MiB")
        if part:
            _put(target, part)
        if unpacker.eof:
            data = unpacker.unused_data
            unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
        else:
            data = unpacker.unconsumed_tail


def _next_member(data: bytes, source: IO[bytes]) -> bytes:
    """Return the data from the next block after the first byte on; empty without one."""
    at = data.find(MEMBER_BEGIN, 1)
    while at < 0:
        if not (more := source.read(_CHUNK_BYTES)):
            return b""
        data = data[1:][-len(MEMBER_BEGIN) :] + more
        at = data.find(MEMBER_BEGIN)
    return data[at:]
