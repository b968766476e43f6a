"""Compressed logs: format, random access, damaged and incomplete files."""

import gzip
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.files import packed as module
from firmware_py.files.packed import (
    PackedFile,
    PlainFile,
    complete_members,
    open_log,
    pack_block,
    pack_index,
    packed_path,
)

BLOCK_BYTES = 1 << 16

SIZES = (0, 1, 90, BLOCK_BYTES - 1, BLOCK_BYTES, BLOCK_BYTES + 1, 3 * BLOCK_BYTES + 77)


def make_content(size):
    return (b"rudder %d, " * (size // 9 + 2) % tuple(range(size // 9 + 2)))[:size]


def pack(content):
    members = [pack_block(content[offset : offset + BLOCK_BYTES]) for offset in range(0, len(content), BLOCK_BYTES)]
    return b"".join(members) + pack_index(len(content), [len(member) for member in members])


def open_packed(path, data):
    path.write_bytes(data)
    return PackedFile(os.open(path, os.O_RDONLY))


def test_members_have_the_headers_of_rfc_1952():
    """Method 8 with an extra field, system 255 (unknown); the field RM has the size of the member, RI the index."""
    assert module.MEMBER_BEGIN.hex(" ") == "1f 8b 08 04 00 00 00 00 00 ff 08 00 52 4d 04 00"
    member = pack_block(b"abc")
    assert member.startswith(module.MEMBER_BEGIN + len(member).to_bytes(4, "little"))
    assert pack_index(3, [50]).hex(" ") == (
        "1f 8b 08 04 00 00 00 00 00 ff 14 00 52 49 10 00 03 00 00 00 00 00 00 00 32 00 00 00 2a 00 00 00 "
        "03 00 00 00 00 00 00 00 00 00"
    )


@pytest.mark.parametrize("size", SIZES)
def test_compressed_log_is_read_by_gzip_and_by_packed_file(tmp_path, size):
    content = make_content(size)
    data = pack(content)
    assert gzip.decompress(data) == content
    file = open_packed(tmp_path / "a.BIN.gz", data)
    assert (file.size, file.read(0, size + 10)) == (size, content)
    file.close()
    assert size < BLOCK_BYTES or len(data) < size / 2


@given(st.integers(0, 3 * BLOCK_BYTES + 100), st.integers(0, 2 * BLOCK_BYTES))
def test_random_access_matches_the_log(tmp_path_factory, offset, count):
    content = make_content(SIZES[-1])
    file = open_packed(tmp_path_factory.getbasetemp() / "any.BIN.gz", pack(content))
    assert file.read(offset, count) == content[offset : offset + count]
    file.close()


@pytest.mark.parametrize("is_checksum", [False, True])
def test_damaged_block_is_an_error_others_are_readable(tmp_path, is_checksum):
    content = make_content(SIZES[-1])
    data = bytearray(pack(content))
    begin, end = (len(pack(content[: blocks * BLOCK_BYTES])) - len(pack(b"")) - 4 * blocks for blocks in (1, 2))
    data[end - 8 if is_checksum else begin + 100] ^= 0x10  # in the second block
    file = open_packed(tmp_path / "a.BIN.gz", bytes(data))
    assert file.read(0, 1000) == content[:1000]
    assert file.read(2 * BLOCK_BYTES, 1000) == content[2 * BLOCK_BYTES :][:1000]
    with pytest.raises(OSError, match="damaged"):
        file.read(BLOCK_BYTES - 10, 100)
    file.close()


@pytest.mark.parametrize("cut", [0, 1, 13, 14, 20, 1000])
def test_incomplete_or_other_file_is_refused_and_closed(tmp_path, cut):
    data = pack(make_content(SIZES[-1]))
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    no_header = bytes(20) + (14).to_bytes(4, "little") + data[-10:]  # an index without a header
    others = [
        data[: len(data) - cut - 1],
        gzip.compress(b"another program"),
        data[cut + 1 :],
        data[:-1] + b"x",
        no_header,
    ]
    for other in others:
        with pytest.raises(OSError, match="gzip -d"):
            open_packed(tmp_path / "a.BIN.gz", other)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count


@given(st.data())
def test_any_bytes_are_read_or_raise_oserror(tmp_path_factory, data):
    content = bytearray(pack(make_content(BLOCK_BYTES + 5)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "odd.BIN.gz"
    try:
        file = open_packed(path, bytes(content))
    except OSError:
        return
    try:
        for offset in range(0, min(file.size, 1 << 20), BLOCK_BYTES):
            file.read(offset, BLOCK_BYTES)
    except OSError:
        pass
    finally:
        file.close()


def test_complete_members_of_an_unfinished_file(tmp_path):
    content = make_content(SIZES[-1])
    members = [pack_block(content[offset : offset + BLOCK_BYTES]) for offset in range(0, len(content), BLOCK_BYTES)]
    sizes = [len(member) for member in members]
    path = tmp_path / "part"
    data = b"".join(members)
    for size, expected in ((0, []), (sizes[0], sizes[:1]), (sum(sizes[:2]) + 7, sizes[:2]), (len(data), sizes)):
        path.write_bytes(data[:size])
        descriptor = os.open(path, os.O_RDONLY)
        assert complete_members(descriptor) == expected
        os.close(descriptor)
    for rest in (bytes(500), b"\x01\x00\x00\x00" * 100):  # after a power cut
        path.write_bytes(data[: sizes[0]] + rest)
        descriptor = os.open(path, os.O_RDONLY)
        assert complete_members(descriptor) == sizes[:1]
        os.close(descriptor)


def test_compressed_log_is_found_by_its_original_name(tmp_path):
    path = tmp_path / "00000001.BIN"
    with pytest.raises(FileNotFoundError):
        open_log(path)
    packed_path(path).write_bytes(pack(b"abc"))
    for name in (path, packed_path(path)):
        file = open_log(name)
        assert (file.size, file.read(1, 9)) == (3, b"bc")
        file.close()
    for name in (path, packed_path(path)):
        packed_path(path).rename(tmp_path / "other")
        name.symlink_to(tmp_path / "other")
        for opened in (path, packed_path(path)):
            with pytest.raises(OSError, match=r"is a symbolic link|No such file"):
                open_log(opened)
        name.unlink()
        (tmp_path / "other").rename(packed_path(path))
    path.write_bytes(b"abcd")
    file = open_log(path)
    assert (file.size, file.read(1, 9)) == (4, b"bcd")
    file.close()


def test_closed_file_has_closed_its_descriptor(tmp_path):
    packed = open_packed(tmp_path / "log.BIN.gz", pack(b"content"))
    for opened in (packed, PlainFile(os.open(__file__, os.O_RDONLY))):
        descriptor = opened._descriptor
        opened.close()
        opened.close()
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
