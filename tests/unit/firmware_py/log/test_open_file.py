"""Compressed logs of this and other programs are read, damaged ones without the damaged blocks."""

import errno
import gzip
import re
import tempfile
from pathlib import Path

import pytest

from firmware_py.files.packed import MEMBER_BEGIN
from firmware_py.log import open_file
from firmware_py.log.archive import archive_log
from firmware_py.log.dataflash import LogError
from firmware_py.log.disk import log_files
from firmware_py.log.reader import LogReader
from firmware_py.log.replay import replay_log


@pytest.fixture
def log(tmp_path, pretend):
    pretend.logged(tmp_path, 60)
    return tmp_path / "00000001.BIN"


def packed(log):
    ticks = list(LogReader(log))
    assert [None for _ in archive_log(log)]
    (path,) = log_files(log.parent).values()
    assert path.name == "00000001.BIN.gz"
    return path, ticks


def test_it_is_read_and_replayed_by_either_name(log, pretend):
    path, ticks = packed(log)
    assert not log.exists()
    assert list(LogReader(path)) == list(LogReader(log)) == ticks
    assert replay_log(path, pretend.restore, pretend.step).identical


def test_one_of_gzip_is_read_too(log):
    ticks = list(LogReader(log))
    content = log.read_bytes()
    (log.parent / "a.BIN.gz").write_bytes(gzip.compress(content[:9000]) + gzip.compress(content[9000:]))
    assert list(LogReader(log.parent / "a.BIN.gz")) == ticks


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9])
def test_one_that_is_cut_or_damaged_is_read_up_to_there(log, part):
    path, ticks = packed(log)
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    found = list(LogReader(path))
    assert found == ticks[: len(found)]
    assert len(found) < len(ticks)
    path.write_bytes(data[: int(part * len(data))] + b"\x00" * 1000)
    assert list(LogReader(path)) == found or part == 0.0


@pytest.mark.parametrize("chunk_bytes", [1000, 1 << 20])
def test_a_damaged_block_is_skipped_and_reported(tmp_path, pretend, monkeypatch, chunk_bytes):
    """A bit of a card, months old, and half of a log of 64 MB was not read."""
    monkeypatch.setattr(open_file, "_CHUNK_BYTES", chunk_bytes)
    pretend.logged(tmp_path, 900)
    path, ticks = packed(tmp_path / "00000001.BIN")
    data = bytearray(path.read_bytes())
    begins = [match.start() for match in re.finditer(re.escape(MEMBER_BEGIN), data)]
    assert len(begins) > 3
    data[(begins[1] + begins[2]) // 2] ^= 1
    path.write_bytes(data)
    reader = LogReader(path)
    found = list(reader)
    assert (found[0], found[-1]) == (ticks[0], ticks[-1])
    lost = len(ticks) - len(found)
    assert 0 < lost < 2 * len(ticks) / len(begins)
    assert any(tick.gap for tick in found)


def test_an_oversized_log_is_rejected(log, monkeypatch):
    path, _ = packed(log)
    monkeypatch.setattr(open_file, "MAX_LOG_BYTES", path.stat().st_size + 1)
    with pytest.raises(LogError, match="unpacks to more than"):
        list(LogReader(path))


def test_a_missing_log_is_an_error_with_a_remedy(tmp_path):
    with pytest.raises(LogError, match=r"No such file or directory: give the path of a \.BIN or \.BIN\.gz file"):
        list(LogReader(tmp_path / "00000007.BIN"))


NO_ROOM = "no room for temporary files to unpack it"


def no_directory(*_words, **_more):
    raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")


def test_a_full_disk_during_unpacking_is_reported(log, monkeypatch):
    path, _ = packed(log)
    monkeypatch.setattr(tempfile, "TemporaryFile", no_directory)
    with pytest.raises(LogError, match=NO_ROOM):
        list(LogReader(path))
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_more: full)
    with Path("/dev/full").open("r+b", buffering=0) as full, pytest.raises(LogError, match=NO_ROOM):
        list(LogReader(path))
