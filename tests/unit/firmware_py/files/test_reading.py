"""Only regular files up to a size limit are read."""

import errno
import json
import os
import socket
from pathlib import Path

import pytest

from firmware_py.files.reading import open_regular, read_json, read_regular, read_text


def pipe(path):
    os.mkfifo(path)


def open_socket(path):
    socket.socket(socket.AF_UNIX).bind(os.path.relpath(path))  # relative: the path of a socket is limited to 108 bytes


def link_to_device(path):
    path.symlink_to("/dev/zero")


def large_file(path):
    path.touch()
    os.truncate(path, 3 << 30)


REFUSED_FILES = {
    pipe: "is a pipe, not a regular file",
    open_socket: "is a socket, not a regular file",
    link_to_device: "is a device, not a regular file",
    large_file: "is larger than 1 MiB",
    os.mkdir: "Is a directory",
}


@pytest.mark.parametrize("make", REFUSED_FILES, ids=lambda make: make.__name__)
@pytest.mark.filterwarnings("ignore:unclosed")
def test_other_types_and_large_files_are_refused_without_reading(make, tmp_path, monkeypatch):
    make(tmp_path / "file")
    monkeypatch.setattr(os, "read", lambda *_: pytest.fail("the file was read"))
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError) as error:
        read_regular(tmp_path / "file", 1 << 20)
    assert error.value.strerror == REFUSED_FILES[make]
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count


def test_nul_in_name_is_an_oserror(tmp_path):
    with pytest.raises(OSError, match="contains a NUL"):
        read_regular(tmp_path / "a\0b", 10)


def test_symbolic_links_are_refused_on_request(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    assert read_regular(tmp_path / "link", 7) == b"content"
    for create in (0, os.O_CREAT):
        with pytest.raises(OSError, match="is a symbolic link"):
            open_regular(tmp_path / "link", flags=os.O_RDWR | create, follow_symlinks=False)
    (tmp_path / "file").unlink()
    with pytest.raises(OSError, match="is a symbolic link"):
        open_regular(tmp_path / "link", flags=os.O_RDWR | os.O_CREAT, mode=0o600, follow_symlinks=False)
    assert not (tmp_path / "file").exists()


def test_file_replaced_after_the_check_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    original_open = os.open
    for replace in (os.mkfifo, link_to_device):

        def open_replaced(path, flags, mode=0, replace=replace):
            required = os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NOCTTY  # opening does not wait for a writer
            assert flags & required == required
            path.unlink()
            replace(path)
            return original_open(path, flags, mode)

        monkeypatch.setattr(os, "open", open_replaced)
        with pytest.raises(OSError) as error:
            read_regular(tmp_path / "file", 10, follow_symlinks=False)
        monkeypatch.undo()
        assert error.value.errno in (errno.EINVAL, errno.ELOOP)
        (tmp_path / "file").unlink()
        (tmp_path / "file").write_bytes(b"")


def test_growing_file_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"12345")
    monkeypatch.setattr(os, "read", lambda _, size: b"x" * size)
    with pytest.raises(OSError, match="is larger than 64 KiB"):
        read_regular(tmp_path / "file", 64 << 10)


def test_limit_itself_is_allowed(tmp_path):
    (tmp_path / "file").write_bytes(b"x" * 3_000_000)
    assert read_regular(tmp_path / "file", 3_000_000) == b"x" * 3_000_000
    for max_bytes, text in ((2_999_999, "2 MiB"), ((1 << 20) - 1, "1023 KiB"), (1 << 20, "1 MiB")):
        with pytest.raises(OSError, match=rf"\[Errno {errno.EFBIG}\] is larger than {text}$"):
            read_regular(tmp_path / "file", max_bytes)


@pytest.mark.parametrize(
    ("mode", "owners", "reason"),
    [
        (0o666, None, None),
        (0o644, {os.geteuid()}, None),
        (0o620, {os.geteuid()}, "is writable by other users"),
        (0o602, {os.geteuid()}, "is writable by other users"),
        (0o600, {os.geteuid() + 1}, f"belongs to user {os.geteuid()}, who is not trusted here"),
    ],
)
def test_owner_and_mode_are_checked_only_on_request(tmp_path, mode, owners, reason):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "file").chmod(mode)
    if reason is None:
        assert read_regular(tmp_path / "file", 7, owners=owners) == b"content"
    else:
        with pytest.raises(PermissionError, match=reason):
            read_regular(tmp_path / "file", 7, owners=owners)


def test_text_must_be_utf_8(tmp_path):
    (tmp_path / "file").write_bytes(b"a\xff")
    with pytest.raises(OSError, match="not UTF-8 text: invalid start byte at byte 1"):
        read_text(tmp_path / "file", 10)


@pytest.mark.parametrize("data", [b"1e15", b"-1e15", b"[" * 12 + b"]" * 12])
def test_json_within_the_limits_is_read(data):
    assert read_json(data) == json.loads(data)


def test_unprintable_characters_of_json_are_escaped():
    assert read_json(b'{"a\\n": ["\\u001b", true, "\xc3\xa9"]}') == {"a\\n": ["\\x1b", True, "\xe9"]}


@pytest.mark.parametrize(
    "data",
    [
        *(b"1000000000000001", b"-1000000000000001", b"1e400", b"NaN"),
        *(b"[" * 13 + b"]" * 13, b'{"a":' * 13 + b"1" + b"}" * 13, b"[" * 10**5),
    ],
)
def test_json_beyond_the_limits_is_refused(data):
    with pytest.raises(ValueError):
        read_json(data)
