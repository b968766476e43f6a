"""Compresses what is closed, a block a step: what stands uncompressed goes when its double is on disk and the same.

A step is a turn of a generator, so that whoever drives it gives it as little of the processor as he likes, and may
leave it at any step: an unfinished double is gone on with, one that is whole beside its log is compared anew.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from firmware_py.files.making import FILE_MODE, sync_directory
from firmware_py.files.packed import (
    BLOCK_BYTES,
    MOST_BLOCKS,
    PackedFile,
    pack_block,
    pack_index,
    packed_path,
    whole_members,
)
from firmware_py.log.disk import part_path

SYNCED_BLOCKS: Final = 16
COMPARED_BLOCKS: Final = 8  # in a step: reading back costs less than compressing


class Span(NamedTuple):
    """A stretch of an open file."""

    descriptor: int
    begin: int
    end: int


class Spans:
    """Stretches of files, read as if they were one."""

    def __init__(self, spans: Sequence[Span]) -> None:
        """Join them in this order."""
        self._spans = tuple(spans)
        self.size = sum(span.end - span.begin for span in spans)

    def read(self, offset: int, count: int) -> bytes:
        """Return what stands there; OSError when there is less than there was."""
        parts = []
        for descriptor, begin, end in self._spans:
            length = end - begin
            if offset < length and count > 0:
                wanted = min(count, length - offset)
                part = os.pread(descriptor, wanted, begin + offset)
                if len(part) != wanted:
                    raise OSError(errno.EIO, "the log has become shorter")
                parts.append(part)
                offset, count = offset + wanted, count - wanted
            offset = max(0, offset - length) if not parts else 0
        return b"".join(parts)


def pack_log(path: Path) -> Iterator[None]:
    """Compress a closed log, put it in the log's place, and remove the log; OSError, and the log stands.

    A log that is removed meanwhile leaves nothing.
    """
    packed = packed_path(path)
    try:
        with contextlib.ExitStack() as opened:
            descriptor = _open(path, os.O_RDONLY, opened)
            source = Spans((Span(descriptor, 0, os.fstat(descriptor).st_size),))
            if packed.exists():  # an earlier try had only the log left to remove
                double = _open(packed, os.O_RDONLY, opened)
                if not (yield from _is_same(double, source)):
                    os.unlink(packed)  # noqa: PTH108 - the calls of os are what the tests let fail, one by one
                    raise OSError(errno.EIO, f"{packed.name} differs from {path.name}")
            else:
                yield from pack(source, packed, os.fstat(descriptor).st_mtime)
            os.unlink(path)  # noqa: PTH108
    except FileNotFoundError:
        part_path(packed).unlink(missing_ok=True)
        packed.unlink(missing_ok=True)
    sync_directory(path.parent)


def pack(source: Spans, packed: Path, modified_s: float) -> Iterator[None]:
    """Compress what is read into a file that appears whole and on disk, or not at all; OSError."""
    if source.size > MOST_BLOCKS * BLOCK_BYTES:
        raise OSError(errno.EFBIG, "too large to be compressed")
    part = part_path(packed)
    with contextlib.ExitStack() as opened:
        target = _open(part, os.O_RDWR | os.O_CREAT, opened)
        yield from _fill(source, target)
        os.fsync(target)
        # What is compared shall be what is on the medium, where the system can forget what it has in memory.
        os.posix_fadvise(target, 0, 0, os.POSIX_FADV_DONTNEED)
        if not (yield from _is_same(target, source)):
            os.ftruncate(target, 0)
            raise OSError(errno.EIO, f"{packed.name} does not read back as it was written")
        os.utime(target, (modified_s, modified_s))
        os.fsync(target)
        os.rename(part, packed)  # noqa: PTH104
    sync_directory(packed.parent)


def _fill(source: Spans, target: int) -> Iterator[None]:
    """Write all members and the index behind those that an earlier try has left."""
    members = whole_members(target)[: source.size // BLOCK_BYTES]
    end = sum(members)
    os.ftruncate(target, end)
    while block := source.read(len(members) * BLOCK_BYTES, BLOCK_BYTES):
        member = pack_block(block)
        _write(target, member, end)
        members.append(len(member))
        end += len(member)
        if len(members) % SYNCED_BLOCKS == 0:
            os.fdatasync(target)  # little by little: so much at once would keep the log waiting
        yield
    _write(target, pack_index(source.size, members), end)


def _is_same(descriptor: int, source: Spans) -> Generator[None, None, bool]:
    """Compare what a double holds with what it was made of, a few blocks a step; the return value says if it is so."""
    try:
        double = PackedFile(os.dup(descriptor))
    except OSError:
        return False
    with contextlib.closing(double):
        if double.size != source.size:
            return False
        for number, offset in enumerate(range(0, source.size, BLOCK_BYTES)):
            expected = source.read(offset, BLOCK_BYTES)
            try:
                if double.read(offset, BLOCK_BYTES) != expected:
                    return False
            except OSError:
                return False
            if number % COMPARED_BLOCKS == 0:
                yield
    return True


def _write(descriptor: int, data: bytes, offset: int) -> None:
    written = 0
    while written < len(data):
        written += os.pwrite(descriptor, data[written:], offset + written)


def _open(path: Path, flags: int, opened: contextlib.ExitStack) -> int:
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, FILE_MODE)
    opened.callback(os.close, descriptor)
    return descriptor
