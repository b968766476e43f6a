"""Reading of compressed logs of this and other programs, also of damaged ones."""

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

NO_ROOM = "no room for temporary files to unpack it"


@pytest.fixture
def log(tmp_path, fake):
    fake.write_log(tmp_path, 60)
    return tmp_path / "00000001.BIN"


def archive(log):
    """Compress a log; return the path of the archive and the ticks."""
    ticks = list(LogReader(log))
    assert [None for _ in archive_log(log)]
    (path,) = log_files(log.parent).values()
    assert path.name == "00000001.BIN.gz"
    return path, ticks


def test_a_compressed_log_is_read_and_replayed_by_either_name(log, fake):
    path, ticks = archive(log)
    assert not log.exists()
    assert list(LogReader(path)) == list(LogReader(log)) == ticks
    assert replay_log(path, fake.restore, fake.step).identical


def test_a_log_compressed_by_gzip_is_read(log):
    content = log.read_bytes()
    (log.parent / "a.BIN.gz").write_bytes(gzip.compress(content[:9000]) + gzip.compress(content[9000:]))
    assert list(LogReader(log.parent / "a.BIN.gz")) == list(LogReader(log))


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.9])
def test_a_truncated_archive_is_read_to_its_end(log, fraction):
    path, all_ticks = archive(log)
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data))])
    ticks = list(LogReader(path))
    assert ticks == all_ticks[: len(ticks)]
    assert len(ticks) < len(all_ticks)
    path.write_bytes(data[: int(fraction * len(data))] + b"\x00" * 1000)
    assert list(LogReader(path)) == ticks or fraction == 0.0


@pytest.mark.parametrize("chunk_bytes", [1000, 1 << 20])
def test_only_a_damaged_block_is_lost(tmp_path, fake, monkeypatch, chunk_bytes):
    monkeypatch.setattr(open_file, "_CHUNK_BYTES", chunk_bytes)
    fake.write_log(tmp_path, 900)
    path, all_ticks = archive(tmp_path / "00000001.BIN")
    data = bytearray(path.read_bytes())
    begins = [match.start() for match in re.finditer(re.escape(MEMBER_BEGIN), data)]
    assert len(begins) > 3
    data[(begins[1] + begins[2]) // 2] ^= 1
    path.write_bytes(data)
    ticks = list(LogReader(path))
    assert (ticks[0], ticks[-1]) == (all_ticks[0], all_ticks[-1])
    assert 0 < len(all_ticks) - len(ticks) < 2 * len(all_ticks) / len(begins)
    assert any(tick.gap for tick in ticks)


def test_an_oversized_log_is_rejected(log, monkeypatch):
    path, _ = archive(log)
    monkeypatch.setattr(open_file, "MAX_LOG_BYTES", path.stat().st_size + 1)
    with pytest.raises(LogError, match="unpacks to more than"):
        list(LogReader(path))


def test_a_log_has_up_to_two_gibibytes(tmp_path):
    path = tmp_path / "log"
    for size in (2 << 30, (2 << 30) + 1):
        with path.open("wb") as file:
            file.truncate(size)
        if size == 2 << 30:
            with open_file.open_buffer(path) as data:
                assert len(data) == size
        else:
            with pytest.raises(OSError, match="large"), open_file.open_buffer(path):
                pass


def test_missing_room_for_temporary_files_is_reported(log, monkeypatch):
    def fail(**_options):
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    path, _ = archive(log)
    monkeypatch.setattr(tempfile, "TemporaryFile", fail)
    with pytest.raises(LogError, match=NO_ROOM):
        list(LogReader(path))
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_options: full)
    with Path("/dev/full").open("r+b", buffering=0) as full, pytest.raises(LogError, match=NO_ROOM):
        list(LogReader(path))
