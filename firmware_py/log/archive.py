"""Compresses closed logs block by block. A log is removed after its archive is on disk and verified.

The functions are generators with one block per step, so the caller limits the processor load and may stop at any step.
The next run continues an unfinished archive and verifies a complete one again.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from firmware_py.files.packed import (
    BLOCK_BYTES,
    MAX_BLOCKS,
    PackedFile,
    complete_members,
    pack_block,
    pack_index,
    packed_path,
)
from firmware_py.files.writing import FILE_MODE, sync_directory
from firmware_py.log.disk import partial_path

BLOCKS_PER_SYNC: Final = 16
BLOCKS_PER_COMPARE_STEP: Final = 8  # reading back costs less than compressing


class Span(NamedTuple):
    """A section of an open file."""

    descriptor: int
    begin: int
    end: int


class Spans:
    """Sections of files that are read as one continuous file."""

    def __init__(self, spans: Sequence[Span]) -> None:
        """Join the sections in the given order."""
        self._spans = tuple(spans)
        self.size = sum(span.end - span.begin for span in spans)

    def read(self, offset: int, count: int) -> bytes:
        """Return up to `count` bytes at an offset; raises OSError if a file has become shorter."""
        parts = []
        for descriptor, begin, end in self._spans:
            length = end - begin
            if offset < length and count > 0:
                part_bytes = min(count, length - offset)
                part = os.pread(descriptor, part_bytes, begin + offset)
                if len(part) != part_bytes:
                    raise OSError(errno.EIO, "the log has become shorter")
                parts.append(part)
                count -= part_bytes
            offset = max(0, offset - length) if not parts else 0
        return b"".join(parts)


def archive_log(path: Path) -> Iterator[None]:
    """Compress a closed log and remove the original; raises OSError, after which the log still exists.

    If another process removes the log during compression, its archive is removed, too.
    """
    packed = packed_path(path)
    try:
        with contextlib.ExitStack() as resources:
            descriptor = _open(path, os.O_RDONLY, resources)
            source = Spans((Span(descriptor, 0, os.fstat(descriptor).st_size),))
            if packed.exists():  # an earlier run was interrupted before it removed the log
                archive = _open(packed, os.O_RDONLY, resources)
                if not (yield from _is_same(archive, source)):
                    os.unlink(packed)  # noqa: PTH108 - tests inject errors into calls of os
                    raise OSError(errno.EIO, f"{packed.name} differs from {path.name}")
            else:
                yield from archive_spans(source, packed, os.fstat(descriptor).st_mtime)
            os.unlink(path)  # noqa: PTH108
    except FileNotFoundError:
        partial_path(packed).unlink(missing_ok=True)
        packed.unlink(missing_ok=True)
    sync_directory(path.parent)


def archive_spans(source: Spans, packed: Path, modified_s: float) -> Iterator[None]:
    """Compress a source into a file that is created atomically, when it is on disk and verified; raises OSError."""
    if source.size > MAX_BLOCKS * BLOCK_BYTES:
        raise OSError(errno.EFBIG, "too large to be compressed")
    part = partial_path(packed)
    with contextlib.ExitStack() as resources:
        target = _open(part, os.O_RDWR | os.O_CREAT, resources)
        yield from _append_members(source, target)
        os.fsync(target)
        # Without cached pages, the comparison reads from the medium.
        os.posix_fadvise(target, 0, 0, os.POSIX_FADV_DONTNEED)
        if not (yield from _is_same(target, source)):
            os.ftruncate(target, 0)
            raise OSError(errno.EIO, f"{packed.name} does not read back as it was written")
        os.utime(target, (modified_s, modified_s))
        os.fsync(target)
        os.rename(part, packed)  # noqa: PTH104
    sync_directory(packed.parent)


def _append_members(source: Spans, target: int) -> Iterator[None]:
    """Append the missing members to a partial archive, then the index."""
    members = complete_members(target)[: source.size // BLOCK_BYTES]
    end = sum(members)
    os.ftruncate(target, end)
    while block := source.read(len(members) * BLOCK_BYTES, BLOCK_BYTES):
        member = pack_block(block)
        _write(target, member, end)
        members.append(len(member))
        end += len(member)
        if len(members) % BLOCKS_PER_SYNC == 0:
            os.fdatasync(target)  # one large sync would delay the log
        yield
    _write(target, pack_index(source.size, members), end)


def _is_same(descriptor: int, source: Spans) -> Generator[None, None, bool]:
    """Return whether an archive contains the same bytes as its source; compares a few blocks per step."""
    try:
        archive = PackedFile(os.dup(descriptor))
    except OSError:
        return False
    with contextlib.closing(archive):
        if archive.size != source.size:
            return False
        for number, offset in enumerate(range(0, source.size, BLOCK_BYTES)):
            expected = source.read(offset, BLOCK_BYTES)
            try:
                if archive.read(offset, BLOCK_BYTES) != expected:
                    return False
            except OSError:
                return False
            if number % BLOCKS_PER_COMPARE_STEP == 0:
                yield
    return True


def _write(descriptor: int, data: bytes, offset: int) -> None:
    written = 0
    while written < len(data):
        written += os.pwrite(descriptor, data[written:], offset + written)


def _open(path: Path, flags: int, resources: contextlib.ExitStack) -> int:
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, FILE_MODE)
    resources.callback(os.close, descriptor)
    return descriptor
