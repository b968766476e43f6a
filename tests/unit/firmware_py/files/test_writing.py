"""Modes of new files and directories, atomic replacement, and closed standard streams."""

import errno
import os
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.files import standard_streams
from firmware_py.files.writing import exact_modes, make_directory, set_aside, write_atomically

DIRECTORY_MODE = 0o750
FILE_MODE = 0o640
PRIVATE_MODE = 0o600


@pytest.fixture(params=[0o000, 0o022, 0o077, 0o777])
def umask(request):
    previous = os.umask(request.param)
    yield request.param
    os.umask(previous)


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_modes_are_independent_of_the_umask(umask, tmp_path):
    with exact_modes():
        make_directory(tmp_path / "a" / "b")
        for name, mode_bits in (("file", FILE_MODE), ("key", PRIVATE_MODE)):
            os.close(os.open(tmp_path / "a" / name, os.O_CREAT | os.O_WRONLY, mode_bits))
    assert os.umask(umask) == umask
    assert (mode(tmp_path / "a"), mode(tmp_path / "a" / "b")) == (DIRECTORY_MODE, DIRECTORY_MODE)
    assert (mode(tmp_path / "a" / "file"), mode(tmp_path / "a" / "key")) == (0o640, 0o600)


def test_modes_without_exact_modes_are_not_wider(tmp_path):
    previous = os.umask(0)
    try:
        make_directory(tmp_path / "a" / "b")
    finally:
        os.umask(previous)
    assert (mode(tmp_path / "a"), mode(tmp_path / "a" / "b")) == (0o750, 0o750)


def test_existing_directory_keeps_its_mode(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a").chmod(0o755)
    make_directory(tmp_path / "a")
    assert mode(tmp_path / "a") == 0o755


def test_file_in_place_of_a_directory_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(NotADirectoryError):
            make_directory(path)


LEFT_BY_A_KILL = {
    "nothing": lambda _path: None,
    "file": lambda path: path.write_text("part"),
    "link": lambda path: path.symlink_to("/dev/null"),
    "directory": lambda path: path.mkdir(),
}


@pytest.mark.parametrize("left", LEFT_BY_A_KILL)
def test_file_is_replaced_whatever_an_interrupted_write_has_left(umask, tmp_path, monkeypatch, left):
    path, synced, write = tmp_path / "file", [], os.write
    LEFT_BY_A_KILL[left](tmp_path / ".file.new")
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:3]))
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(Path(f"/proc/self/fd/{descriptor}").readlink()))
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    write_atomically(path, b"content")
    assert (path.read_bytes(), mode(path)) == (b"content", FILE_MODE)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count
    assert synced == [tmp_path / ".file.new", tmp_path]
    write_atomically(path, b"secret", PRIVATE_MODE)
    assert (path.read_bytes(), mode(path)) == (b"secret", PRIVATE_MODE)
    names = {"file", ".file.new.aside"} if left == "directory" else {"file"}
    assert {entry.name for entry in tmp_path.iterdir()} == names


@pytest.mark.parametrize("name", ["write", "fsync", "replace"])
def test_failed_write_leaves_the_old_file_alone(tmp_path, monkeypatch, name):
    def fail(*_arguments):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    (tmp_path / "file").write_bytes(b"old")
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    monkeypatch.setattr(os, name, fail)
    with pytest.raises(OSError, match="Input/output error"):
        write_atomically(tmp_path / "file", b"new")
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == {"file": b"old"}
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count


def test_entry_is_set_aside_with_a_number_if_a_directory_has_its_name(tmp_path):
    for number in range(10):
        (tmp_path / "a").mkdir()
        assert set_aside(tmp_path / "a") == tmp_path / f"a.aside{number or ''}"
    (tmp_path / "a").touch()
    with pytest.raises(FileExistsError, match="too many renamed copies of a; delete some"):
        set_aside(tmp_path / "a")
    (tmp_path / "a.aside3").rmdir()
    for _ in range(2):  # a file replaces a file
        (tmp_path / "a").touch()
        assert set_aside(tmp_path / "a") == tmp_path / "a.aside3"


def test_closed_standard_streams_are_replaced_by_dev_null(monkeypatch):
    free, inheritable, closed = [1, 2, 3], [], []
    calls = SimpleNamespace(
        open=lambda path, flags: free.pop(0) if (path, flags) == ("/dev/null", os.O_RDWR) else -1,
        set_inheritable=lambda *values: inheritable.append(values), close=closed.append,
        devnull="/dev/null", O_RDWR=os.O_RDWR,
    )  # fmt: skip
    monkeypatch.setattr(standard_streams, "os", calls)
    for name in ("stdin", "stdout"):
        monkeypatch.setattr(sys, name, None)
    error_stream = sys.stderr
    standard_streams.open_closed_streams()
    with sys.stdin, sys.stdout:
        assert (inheritable, closed) == ([(1, True), (2, True)], [3])
        assert (sys.stdin.read(), sys.stdout.write("lost"), sys.stderr) == ("", 4, error_stream)
