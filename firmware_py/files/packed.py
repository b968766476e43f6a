"""Compressed logs: gzip (RFC 1952) in members of one block each, so that any place is read without the rest.

A member holds BLOCK_BYTES of the file, the last one what is left, and says in its extra field how long it is. An empty
member behind them has the index: the size of the file and of every member. `gzip -d` reads it as any other file.
"""

from __future__ import annotations

import errno
import itertools
import os
import struct
import zlib
from pathlib import Path
from typing import Final

from firmware_py.files.reading import open_regular

SUFFIX: Final = ".gz"
BLOCK_BYTES: Final = 1 << 16
MOST_BLOCKS: Final = 16_000  # whose sizes one extra field holds: files up to 1048 MB
_LEVEL: Final = 6
# Mark, deflate, an extra field; no time, no system; length of all extra fields, name and length of ours.
_HEAD = struct.Struct("<4sIBBH2sH")
_MARK: Final = b"\x1f\x8b\x08\x04"
_MEMBER, _INDEX = b"RM", b"RI"
_SIZE = struct.Struct("<I")
_TOTAL = struct.Struct("<Q")
_TAIL = struct.Struct("<II")  # CRC-32 and size of what was packed
_EMPTY: Final = b"\x03\x00" + bytes(_TAIL.size)
MEMBER_BEGIN: Final = _HEAD.pack(_MARK, 0, 0, 255, _SIZE.size + 4, _MEMBER, _SIZE.size)  # of each that holds a block


def pack_block(data: bytes) -> bytes:
    """Return the member that holds a block."""
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    body = packer.compress(data) + packer.flush() + _TAIL.pack(zlib.crc32(data), len(data))
    return _head(_MEMBER, _SIZE.pack(_HEAD.size + _SIZE.size + len(body))) + body


def pack_index(size: int, members: list[int]) -> bytes:
    """Return the last member of a file of this size, of members of these sizes."""
    extra = _TOTAL.pack(size) + b"".join(map(_SIZE.pack, members))
    whole = _HEAD.size + len(extra) + _SIZE.size + len(_EMPTY)
    return _head(_INDEX, extra + _SIZE.pack(whole)) + _EMPTY


def whole_members(descriptor: int) -> list[int]:
    """Return the sizes of the members that stand whole at the beginning of an unfinished file."""
    sizes: list[int] = []
    begin, end = 0, os.fstat(descriptor).st_size
    while (size := _member_size(os.pread(descriptor, _HEAD.size + _SIZE.size, begin))) and begin + size <= end:
        sizes.append(size)
        begin += size
    return sizes


def _head(name: bytes, extra: bytes) -> bytes:
    return _HEAD.pack(_MARK, 0, 0, 255, len(extra) + 4, name, len(extra)) + extra


def _member_size(head: bytes) -> int:
    """Return the size that a member says of itself, 0 for what is none."""
    if len(head) < _HEAD.size + _SIZE.size:
        return 0
    mark, _, _, _, _, name, length = _HEAD.unpack_from(head)
    if (mark, name, length) != (_MARK, _MEMBER, _SIZE.size):
        return 0
    return int(_SIZE.unpack_from(head, _HEAD.size)[0])


class PackedFile:
    """A compressed log, read at any place; `size` and `modified_s` are those of the log. It owns its descriptor."""

    __slots__ = ("_block", "_descriptor", "_ends", "_number", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Read the index; OSError, the descriptor closed, for what has none."""
        self._descriptor = descriptor
        self._number, self._block = -1, b""
        self.modified_s = os.fstat(descriptor).st_mtime
        try:
            self.size, self._ends = _read_index(descriptor)
        except BaseException:
            os.close(descriptor)
            raise

    def read(self, offset: int, count: int) -> bytes:
        """Return what stands there, less than count bytes at the end; OSError for a block that is damaged."""
        parts = []
        while count > 0 and offset < self.size:
            number, begin = divmod(offset, BLOCK_BYTES)
            piece = self._unpacked(number)[begin : begin + count]
            parts.append(piece)
            offset, count = offset + len(piece), count - len(piece)
        return b"".join(parts)

    def close(self) -> None:
        """Give up the descriptor."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def _unpacked(self, number: int) -> bytes:
        if number != self._number:
            begin = self._ends[number - 1] if number else 0
            member = os.pread(self._descriptor, self._ends[number] - begin, begin)
            self._block = _unpack_block(member, min(BLOCK_BYTES, self.size - number * BLOCK_BYTES))
            self._number = number
        return self._block


class PlainFile:
    """A file as it is, read as a PackedFile is: of the size that it had when it was opened."""

    __slots__ = ("_descriptor", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Own a descriptor."""
        self._descriptor = descriptor
        status = os.fstat(descriptor)
        self.size, self.modified_s = status.st_size, status.st_mtime

    def read(self, offset: int, count: int) -> bytes:
        """Return what stands there; OSError when it cannot be read."""
        return os.pread(self._descriptor, count, offset)

    def close(self) -> None:
        """Give up the descriptor."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


def packed_path(path: Path) -> Path:
    """Return where a log is to be found once it is compressed."""
    return path.with_name(path.name + SUFFIX)


def open_log(path: Path) -> PlainFile | PackedFile:
    """Open a log, compressed or not; one that has been compressed since it was named is found too. OSError."""
    if path.suffix == SUFFIX:
        return PackedFile(open_regular(path, follow=False))
    try:
        return PlainFile(open_regular(path, follow=False))
    except FileNotFoundError:
        try:
            return PackedFile(open_regular(packed_path(path), follow=False))
        except FileNotFoundError:
            pass
        raise


def _read_index(descriptor: int) -> tuple[int, list[int]]:
    """Return the size of the log and where its members end."""
    end = os.fstat(descriptor).st_size
    tail = os.pread(descriptor, _SIZE.size + len(_EMPTY), max(0, end - _SIZE.size - len(_EMPTY)))
    if len(tail) < _SIZE.size + len(_EMPTY) or tail[_SIZE.size :] != _EMPTY:
        raise _not_ours()
    begin = end - _SIZE.unpack_from(tail)[0]
    if not 0 <= begin <= end - _HEAD.size - _TOTAL.size - len(tail):
        raise _not_ours()
    index = os.pread(descriptor, end - begin, begin)
    mark, _, _, _, _, name, length = _HEAD.unpack_from(index)
    if (mark, name, length) != (_MARK, _INDEX, len(index) - _HEAD.size - len(_EMPTY)):
        raise _not_ours()
    size = int(_TOTAL.unpack_from(index, _HEAD.size)[0])
    sizes = index[_HEAD.size + _TOTAL.size : -len(tail)]
    if len(sizes) % _SIZE.size:
        raise _not_ours()
    ends = list(itertools.accumulate(member for (member,) in _SIZE.iter_unpack(sizes)))
    if len(ends) != -(-size // BLOCK_BYTES) or (ends and ends[-1] != begin):
        raise _not_ours()
    return size, ends


def _unpack_block(member: bytes, size: int) -> bytes:
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        block = unpacker.decompress(member[_HEAD.size + _SIZE.size :], size + 1)
    except zlib.error:
        block = b""
    if len(block) != size or unpacker.unused_data != _TAIL.pack(zlib.crc32(block), size):
        raise OSError(errno.EIO, "is damaged")
    return block


def _not_ours() -> OSError:
    return OSError(errno.EILSEQ, "is no log that rambler has compressed, or not whole: unpack it with gzip -d")
