"""Texts of system errors: cause and remedy in one line."""

import errno
import os
from pathlib import Path

import pytest

from firmware_py.common.system_errors import system_error_text


def with_cause(error, cause):
    try:
        raise error from cause
    except type(error) as raised:
        return raised


@pytest.mark.parametrize(
    ("error", "expected_start"),
    [
        (MemoryError(), "out of memory"),
        (OSError(errno.ENOMEM, "x"), "out of memory"),
        (OSError(errno.EMFILE, "x", "/some/path"), "too many open files"),
        (OSError(errno.ENFILE, "x"), "too many open files"),
        (BlockingIOError(errno.EAGAIN, "fork"), "cannot start a thread or process"),
        (RuntimeError("can't start new thread"), "cannot start a thread or process"),
        (ImportError("libx.so: failed to map segment from shared object"), "out of memory"),
        (ImportError("libx.so: cannot open shared object file: Too many open files"), "too many open files"),
        (with_cause(ImportError("a page\nof advice"), ImportError("libx.so: failed to map segment")), "out of memory"),
        (OSError(errno.ENOSPC, "No space left on device"), "a disk is full (see df)"),
        (OSError(errno.ENOSPC, "No space left on device", "aaa"), "aaa: No space left on device; use another path"),
        (FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']"), "No usable temporary dir"),
        (
            UnicodeEncodeError("utf-8", "B\udcf8t/", 1, 2, "surrogates not allowed"),
            "name 'B\\udcf8': not representable",
        ),
        (
            UnicodeEncodeError("utf-8", "x" * 10 + "y" * 30 + "\udcf8t", 40, 41, "surrogates not allowed"),
            f"name '{'y' * 30}\\udcf8': not representable",
        ),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), "a disk is full (see df)"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "aaa"), "aaa: File name too long; use another path"),
    ],
)
def test_text_of_a_system_error_is_one_line_with_a_remedy(error, expected_start):
    text = system_error_text(error)
    assert text.startswith(expected_start)
    assert ";" in text
    assert "\n" not in text


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError("a mistake"),
        ValueError("x"),
        OSError(errno.EIO, os.strerror(errno.EIO)),
        ImportError("x"),
        FileNotFoundError("x"),
        UnicodeEncodeError("ascii", "\xe9", 0, 1, "ordinal not in range(128)"),
    ],
)
def test_other_errors_have_no_text(error):
    assert system_error_text(error) == ""


def test_text_of_a_removed_working_directory(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as raised:
        Path("a").absolute()
    text = "the working directory no longer exists; change to another one"
    assert system_error_text(raised.value) == text
