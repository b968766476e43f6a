"""Modes of new files and directories."""

import os
import stat

import pytest

from firmware_py.files.writing import exact_modes, make_directory

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
