"""Compressed logs: gzip (RFC 1952) with one member per block, for random access.

A member contains BLOCK_BYTES of the file (the last one fewer) and its own length in the extra field. An empty member at
the end contains the index: the size of the file and of each member. `gzip -d` unpacks the file as usual.
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
MAX_BLOCKS: Final = 16_000  # as many as an extra field can list: files up to 1048 MB
_LEVEL: Final = 6
# Magic number, method and flags; time; extra flags; system; length of all extra fields; name and length of this one.
_HEADER = struct.Struct("<4sIBBH2sH")
_MARK: Final = b"\x1f\x8b\x08\x04"
_MEMBER, _INDEX = b"RM", b"RI"  # names of the extra field
_SIZE = struct.Struct("<I")
_TOTAL = struct.Struct("<Q")
_TAIL = struct.Struct("<II")  # CRC-32 and size of the unpacked data
_EMPTY: Final = b"\x03\x00" + bytes(_TAIL.size)  # a compressed block without data
MEMBER_BEGIN: Final = _HEADER.pack(_MARK, 0, 0, 255, _SIZE.size + 4, _MEMBER, _SIZE.size)  # of each member but the last


def pack_block(data: bytes) -> bytes:
    """Compress a block into a member."""
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    body = packer.compress(data) + packer.flush() + _TAIL.pack(zlib.crc32(data), len(data))
    return _build_header(_MEMBER, _SIZE.pack(_HEADER.size + _SIZE.size + len(body))) + body


def pack_index(size: int, members: list[int]) -> bytes:
    """Return the index member for the size of the file and the sizes of its members."""
    extra = _TOTAL.pack(size) + b"".join(map(_SIZE.pack, members))
    index_bytes = _HEADER.size + len(extra) + _SIZE.size + len(_EMPTY)
    return _build_header(_INDEX, extra + _SIZE.pack(index_bytes)) + _EMPTY


def complete_members(descriptor: int) -> list[int]:
    """Return the sizes of the complete members at the start of an incomplete file."""
    sizes: list[int] = []
    begin, end = 0, os.fstat(descriptor).st_size
    while (size := _member_size(os.pread(descriptor, _HEADER.size + _SIZE.size, begin))) and begin + size <= end:
        sizes.append(size)
        begin += size
    return sizes


def _build_header(name: bytes, extra: bytes) -> bytes:
    return _HEADER.pack(_MARK, 0, 0, 255, len(extra) + 4, name, len(extra)) + extra


def _member_size(head: bytes) -> int:
    """Return the size of a member from its header, 0 for an invalid header."""
    if len(head) < _HEADER.size + _SIZE.size:
        return 0
    mark, _, _, _, _, name, length = _HEADER.unpack_from(head)
    if (mark, name, length) != (_MARK, _MEMBER, _SIZE.size):
        return 0
    return int(_SIZE.unpack_from(head, _HEADER.size)[0])


class PackedFile:
    """A compressed log with random access; it owns its descriptor.

    `size` is the size of the uncompressed log in bytes, `modified_s` its modification time.
    """

    __slots__ = ("_cached_block", "_cached_number", "_descriptor", "_ends", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Read the index; close the descriptor and raise OSError if it is invalid."""
        self._descriptor = descriptor
        self._cached_number, self._cached_block = -1, b""
        self.modified_s = os.fstat(descriptor).st_mtime
        try:
            self.size, self._ends = _read_index(descriptor)
        except BaseException:
            os.close(descriptor)
            raise

    def read(self, offset: int, count: int) -> bytes:
        """Return up to `count` bytes at an offset; raise OSError for a damaged block."""
        pieces = []
        while count > 0 and offset < self.size:
            number, begin = divmod(offset, BLOCK_BYTES)
            piece = self._read_block(number)[begin : begin + count]
            pieces.append(piece)
            offset, count = offset + len(piece), count - len(piece)
        return b"".join(pieces)

    def close(self) -> None:
        """Close the descriptor."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def _read_block(self, number: int) -> bytes:
        if number != self._cached_number:
            begin = self._ends[number - 1] if number else 0
            member = os.pread(self._descriptor, self._ends[number] - begin, begin)
            self._cached_block = _unpack_block(member, min(BLOCK_BYTES, self.size - number * BLOCK_BYTES))
            self._cached_number = number
        return self._cached_block


class PlainFile:
    """An uncompressed log with the interface of PackedFile; its size is the size at opening."""

    __slots__ = ("_descriptor", "modified_s", "size")

    def __init__(self, descriptor: int) -> None:
        """Take ownership of a descriptor."""
        self._descriptor = descriptor
        status = os.fstat(descriptor)
        self.size, self.modified_s = status.st_size, status.st_mtime

    def read(self, offset: int, count: int) -> bytes:
        """Return up to `count` bytes at an offset; raise OSError on failure."""
        return os.pread(self._descriptor, count, offset)

    def close(self) -> None:
        """Close the descriptor."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1


def packed_path(path: Path) -> Path:
    """Return the path of the compressed file of a log."""
    return path.with_name(path.name + SUFFIX)


def open_log(path: Path) -> PlainFile | PackedFile:
    """Open a log, or its compressed file if it has been archived; raise OSError on failure."""
    if path.suffix == SUFFIX:
        return PackedFile(open_regular(path, follow_symlinks=False))
    try:
        return PlainFile(open_regular(path, follow_symlinks=False))
    except FileNotFoundError:
        try:
            return PackedFile(open_regular(packed_path(path), follow_symlinks=False))
        except FileNotFoundError:
            pass
        raise


def _read_index(descriptor: int) -> tuple[int, list[int]]:
    """Return the size of the log and the end offsets of its members; raise OSError for an invalid index."""
    end = os.fstat(descriptor).st_size
    tail = os.pread(descriptor, _SIZE.size + len(_EMPTY), max(0, end - _SIZE.size - len(_EMPTY)))
    if len(tail) < _SIZE.size + len(_EMPTY) or tail[_SIZE.size :] != _EMPTY:
        raise _invalid_index_error()
    begin = end - _SIZE.unpack_from(tail)[0]
    if not 0 <= begin <= end - _HEADER.size - _TOTAL.size - len(tail):
        raise _invalid_index_error()
    index = os.pread(descriptor, end - begin, begin)
    mark, _, _, _, _, name, length = _HEADER.unpack_from(index)
    if (mark, name, length) != (_MARK, _INDEX, len(index) - _HEADER.size - len(_EMPTY)):
        raise _invalid_index_error()
    size = int(_TOTAL.unpack_from(index, _HEADER.size)[0])
    sizes = index[_HEADER.size + _TOTAL.size : -len(tail)]
    if len(sizes) % _SIZE.size:
        raise _invalid_index_error()
    ends = list(itertools.accumulate(member for (member,) in _SIZE.iter_unpack(sizes)))
    if len(ends) != -(-size // BLOCK_BYTES) or (ends and ends[-1] != begin):
        raise _invalid_index_error()
    return size, ends


def _unpack_block(member: bytes, size: int) -> bytes:
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        block = unpacker.decompress(member[_HEADER.size + _SIZE.size :], size + 1)
    except zlib.error:
        block = b""
    if len(block) != size or unpacker.unused_data != _TAIL.pack(zlib.crc32(block), size):
        raise OSError(errno.EIO, "is damaged")
    return block


def _invalid_index_error() -> OSError:
    return OSError(errno.EILSEQ, "is not a log compressed by rambler, or incomplete; unpack it with gzip -d")
