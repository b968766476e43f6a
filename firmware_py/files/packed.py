"""Compressed logs: gzip (RFC 1952) with one member per block, for random access.

A member contains BLOCK_BYTES of the file (the last one the rest) and its own length in the extra field. An empty member
at the end contains the index: the size of the file and of each member. `gzip -d` unpacks the file as usual.
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
MAX_BLOCKS: Final = 16_000  # limit of an extra field: files up to 1048 MB
_LEVEL: Final = 6
# Magic, deflate, flags; time 0, system unknown; length of all extra fields, name and length of this one.
_HEAD = struct.Struct("<4sIBBH2sH")
_MARK: Final = b"\x1f\x8b\x08\x04"
_MEMBER, _INDEX = b"RM", b"RI"
_SIZE = struct.Struct("<I")
_TOTAL = struct.Struct("<Q")
_TAIL = struct.Struct("<II")  # CRC-32 and size of the unpacked data
_EMPTY: Final = b"\x03\x00" + bytes(_TAIL.size)
MEMBER_BEGIN: Final = _HEAD.pack(_MARK, 0, 0, 255, _SIZE.size + 4, _MEMBER, _SIZE.size)  # of each member with a block


def pack_block(data: bytes) -> bytes:
    """Return the compressed member of a block."""
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    body = packer.compress(data) + packer.flush() + _TAIL.pack(zlib.crc32(data), len(data))
    return _head(_MEMBER, _SIZE.pack(_HEAD.size + _SIZE.size + len(body))) + body


def pack_index(size: int, members: list[int]) -> bytes:
    """Return the index member for a file size and the sizes of its members."""
    extra = _TOTAL.pack(size) + b"".join(map(_SIZE.pack, members))
    whole = _HEAD.size + len(extra) + _SIZE.size + len(_EMPTY)
    return _head(_INDEX, extra + _SIZE.pack(whole)) + _EMPTY


def complete_members(descriptor: int) -> list[int]:
    """Return the sizes of the complete members at the start of an unfinished file."""
    sizes: list[int] = []
    begin, end = 0, os.fstat(descriptor).st_size
    while (size := _member_size(os.pread(descriptor, _HEAD.size + _SIZE.size, begin))) and begin + size <= end:
        sizes.append(size)
        begin += size
    return sizes


def _head(name: bytes, extra: bytes) -> bytes:
    return _HEAD.pack(_MARK, 0, 0, 255, len(extra) + 4, name, len(extra)) + extra


def _member_size(head: bytes) -> int:
    """Return the size in the header of a member, 0 for an invalid header."""
    if len(head) < _HEAD.size + _SIZE.size:
        return 0
    mark, _, _, _, _, name, length = _HEAD.unpack_from(head)
    if (mark, name, length) != (_MARK, _MEMBER, _SIZE.size):
        return 0
    return int(_SIZE.unpack_from(head, _HEAD.size)[0])


class PackedFile:
    """A compressed log with random access; `size` and `modified_s` are those of the log. It owns its descriptor."""

    __slots__ = ("_block", "_descriptor", "_ends", "_number", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Read the index; without a valid one close the descriptor and raise OSError."""
        self._descriptor = descriptor
        self._number, self._block = -1, b""
        self.modified_s = os.fstat(descriptor).st_mtime
        try:
            self.size, self._ends = _read_index(descriptor)
        except BaseException:
            os.close(descriptor)
            raise

    def read(self, offset: int, count: int) -> bytes:
        """Return up to count bytes at an offset; raise OSError for a damaged block."""
        parts = []
        while count > 0 and offset < self.size:
            number, begin = divmod(offset, BLOCK_BYTES)
            piece = self._unpacked(number)[begin : begin + count]
            parts.append(piece)
            offset, count = offset + len(piece), count - len(piece)
        return b"".join(parts)

    def close(self) -> None:
        """Close the descriptor."""
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
    """An uncompressed log with the interface of PackedFile; its size is that at opening."""

    __slots__ = ("_descriptor", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Take ownership of a descriptor."""
        self._descriptor = descriptor
        status = os.fstat(descriptor)
        self.size, self.modified_s = status.st_size, status.st_mtime

    def read(self, offset: int, count: int) -> bytes:
        """Return up to count bytes at an offset; raise OSError on failure."""
        return os.pread(self._descriptor, count, offset)

    def close(self) -> None:
        """Close the descriptor."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


def packed_path(path: Path) -> Path:
    """Return the path of a log after compression."""
    return path.with_name(path.name + SUFFIX)


def open_log(path: Path) -> PlainFile | PackedFile:
    """Open a log, also if it has been compressed meanwhile; raise OSError on failure."""
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
    """Return the size of the log and the end offsets of its members."""
    end = os.fstat(descriptor).st_size
    tail = os.pread(descriptor, _SIZE.size + len(_EMPTY), max(0, end - _SIZE.size - len(_EMPTY)))
    if len(tail) < _SIZE.size + len(_EMPTY) or tail[_SIZE.size :] != _EMPTY:
        raise _invalid()
    begin = end - _SIZE.unpack_from(tail)[0]
    if not 0 <= begin <= end - _HEAD.size - _TOTAL.size - len(tail):
        raise _invalid()
    index = os.pread(descriptor, end - begin, begin)
    mark, _, _, _, _, name, length = _HEAD.unpack_from(index)
    if (mark, name, length) != (_MARK, _INDEX, len(index) - _HEAD.size - len(_EMPTY)):
        raise _invalid()
    size = int(_TOTAL.unpack_from(index, _HEAD.size)[0])
    sizes = index[_HEAD.size + _TOTAL.size : -len(tail)]
    if len(sizes) % _SIZE.size:
        raise _invalid()
    ends = list(itertools.accumulate(member for (member,) in _SIZE.iter_unpack(sizes)))
    if len(ends) != -(-size // BLOCK_BYTES) or (ends and ends[-1] != begin):
        raise _invalid()
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


def _invalid() -> OSError:
    return OSError(errno.EILSEQ, "is not a log compressed by rambler, or incomplete; unpack it with gzip -d")
