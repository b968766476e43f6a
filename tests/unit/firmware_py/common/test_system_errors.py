import errno
import os
from pathlib import Path

import pytest

from firmware_py.common.system_errors import system_error_text


def caused(error, cause):
    try:
        raise error from cause
    except type(error) as raised:
        return raised


@pytest.mark.parametrize(
    ("error", "reported"),
    [
        (MemoryError(), "out of memory"),
        (OSError(errno.ENOMEM, "x"), "out of memory"),
        (OSError(errno.EMFILE, "x", "/some/path"), "too many open files"),
        (OSError(errno.ENFILE, "x"), "too many open files"),
        (BlockingIOError(errno.EAGAIN, "fork"), "cannot start a thread or process"),
        (RuntimeError("can't start new thread"), "cannot start a thread or process"),
        (ImportError("libx.so: failed to map segment from shared object"), "out of memory"),
        (ImportError("libx.so: cannot open shared object file: Too many open files"), "too many open files"),
        (caused(ImportError("a page\nof advice"), ImportError("libx.so: failed to map segment")), "out of memory"),
        (OSError(errno.ENOSPC, "No space left on device"), "a disk is full (see df)"),
        (OSError(errno.ENOSPC, "No space left on device", "aaa"), "aaa: No space left on device; use another path"),
        (FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']"), "No usable temporary dir"),
        (
            UnicodeEncodeError("utf-8", "in B\udcf8t/", 4, 5, "surrogates not allowed"),
            "name 'in B\\udcf8': not representable",
        ),
        (OSError(errno.ENAMETOOLONG, "File name too long", "aaa"), "aaa: File name too long; use another path"),
    ],
)
def test_system_errors_are_one_line_with_a_remedy(error, reported):
    text = system_error_text(error)
    assert text.startswith(reported)
    assert ";" in text
    assert "\n" not in text


@pytest.mark.parametrize(
    "error", [RuntimeError("a mistake"), ValueError("x"), OSError(errno.EIO, os.strerror(errno.EIO)), ImportError("x")]
)
def test_program_errors_keep_their_traceback(error):
    assert system_error_text(error) == ""


def test_a_removed_working_directory_has_its_own_text(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as raised:
        Path("a").absolute()
    text = "the working directory no longer exists; change to another one"
    assert system_error_text(raised.value) == text
