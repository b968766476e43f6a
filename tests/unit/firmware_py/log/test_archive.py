"""Compression of closed logs: whatever call of the system fails, the log is there, whole, by one name or the other."""

import contextlib
import errno
import gzip
import os
import shutil
import tracemalloc

import pytest

from firmware_py.files.packed import BLOCK_BYTES, open_log, packed_path
from firmware_py.log.archive import Span, Spans, archive_log
from firmware_py.log.disk import log_files, part_path
from support.faulty_disk import CALLS, CUTS, KINDS, FaultyDisk

CONTENT = b"".join(b"heading %d, " % (number * number) for number in range(12_000))  # three blocks and a bit
SHORT = CONTENT[:13_000]
MODIFIED_S = 1_800_000_000
assert 3 * BLOCK_BYTES < len(CONTENT) < 4 * BLOCK_BYTES


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "00000001.BIN"
    path.write_bytes(CONTENT)
    os.utime(path, (MODIFIED_S, MODIFIED_S))
    return path


def content_of(directory):
    """What a reader finds of the only log."""
    (path,) = log_files(directory).values()
    file = open_log(path)
    try:
        return file.read(0, file.size)
    finally:
        file.close()


def names(directory):
    return sorted(path.name for path in directory.iterdir())


def finish(path):
    """Compress in as many tries as the disk needs, which fails no more."""
    for _ in range(3):
        if not path.exists() or path.suffix != ".BIN":
            return
        for _ in archive_log(path):
            pass


def test_a_log_is_replaced_by_one_that_gzip_reads(log):
    for _ in archive_log(log):
        assert content_of(log.parent) == CONTENT  # at every step
    assert names(log.parent) == ["00000001.BIN.gz"]
    assert gzip.decompress(packed_path(log).read_bytes()) == CONTENT
    assert packed_path(log).stat().st_mtime == MODIFIED_S
    assert packed_path(log).stat().st_size < len(CONTENT) / 2


def test_memory_does_not_depend_on_the_length_of_the_log(log):
    log.write_bytes(bytes(40 * BLOCK_BYTES))
    tracemalloc.start()
    try:
        finish(log)
        _, max_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert max_bytes < 8 * BLOCK_BYTES  # the packer's own state is four


def test_an_empty_log_is_archived(log):
    log.write_bytes(b"")
    finish(log)
    assert content_of(log.parent) == b""


@pytest.mark.parametrize("steps", range(6))
def test_archiving_continues_after_a_kill(log, steps):
    job = archive_log(log)
    for _ in range(steps):
        next(job)
    job.close()  # the descriptors; the files are as a kill leaves them
    done = part_path(packed_path(log)).read_bytes()[: 1 << 16] if steps else b""
    written = []
    real = os.pwrite

    def count(descriptor, data, offset):
        written.append(offset)
        return real(descriptor, data, offset)

    with pytest.MonkeyPatch.context() as patches:
        patches.setattr(os, "pwrite", count)
        finish(log)
    assert content_of(log.parent) == CONTENT
    assert packed_path(log).read_bytes().startswith(done)
    # The whole blocks of before are not written again; the last is shorter and is, with the index.
    assert len(written) == 5 - min(steps, 3)


def test_a_part_of_another_log_is_discarded(log):
    other = CONTENT[::-1]
    log.write_bytes(other)
    job = archive_log(log)
    next(job), next(job)
    job.close()
    log.write_bytes(CONTENT)
    with pytest.raises(OSError, match="does not read back"):
        finish(log)
    assert log.read_bytes() == CONTENT
    finish(log)
    assert content_of(log.parent) == CONTENT


def test_before_the_last_step_both_files_exist_and_one_is_listed(log):
    copy = log.read_bytes()
    finish(log)
    log.write_bytes(copy)
    assert log_files(log.parent) == {1: log}
    finish(log)
    assert names(log.parent) == ["00000001.BIN.gz"]


def test_an_archive_that_differs_is_removed_and_the_log_stays(log):
    finish(log)
    log.write_bytes(CONTENT[:-1] + b"!")
    with pytest.raises(OSError, match="differs"):
        finish(log)
    assert names(log.parent) == ["00000001.BIN"]


def test_a_log_erased_during_archiving_leaves_no_archive(log):
    for steps in range(8):
        log.write_bytes(CONTENT)
        job = archive_log(log)
        for _ in zip(range(steps), job, strict=False):
            pass
        log.unlink(missing_ok=True)
        packed_path(log).unlink(missing_ok=True)
        for _ in job:
            pass
        assert names(log.parent) == []


def test_a_full_disk_leaves_the_log(log, monkeypatch):
    def full(_descriptor, _data, _offset):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", full)
        with pytest.raises(OSError, match="No space"):
            finish(log)
    assert log.read_bytes() == CONTENT
    finish(log)
    assert content_of(log.parent) == CONTENT


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_of_any_call_loses_nothing(tmp_path, kind, monkeypatch):
    """Each call of the system in turn, once; the disk as it is then, and as a power cut leaves it."""
    for room in ("files.packed", "log.archive"):
        monkeypatch.setattr(f"firmware_py.{room}.BLOCK_BYTES", 4096)
    number, failed = 0, set()
    while True:
        directory = tmp_path / f"{kind}{number}"
        directory.mkdir()
        log = directory / "00000001.BIN"
        log.write_bytes(SHORT)
        with monkeypatch.context() as patches:
            disk = FaultyDisk(directory, patches)
            disk.durable[log.name], disk.named[log.name] = SHORT, None
            disk.arm(number, kind)
            with contextlib.suppress(OSError):
                finish(log)
            failed.update(disk.failed)
            was_reached = bool(disk.failed)
            disk.arm(None)
            for cut in CUTS:
                disk.cut(tmp_path / f"{kind}{number}{cut}", cut)
        for after in (directory, *(tmp_path / f"{kind}{number}{cut}" for cut in CUTS)):
            assert content_of(after) == SHORT
            (left,) = log_files(after).values()
            for _ in range(2):  # a part that the cut has spoiled costs one try
                with contextlib.suppress(OSError):
                    finish(left)
            assert content_of(after) == SHORT
            assert names(after) == ["00000001.BIN.gz"]
            shutil.rmtree(after)
        if not was_reached:
            break
        number += 1
    assert {"open", "pwrite", "fsync", "rename", "unlink", "ftruncate", "close"} - failed == set()
    assert set(CALLS) >= failed


def test_spans_are_read_as_one_file(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(bytes(range(100)))
    descriptor = os.open(path, os.O_RDONLY)
    spans = Spans(
        (Span(descriptor, 10, 20), Span(descriptor, 50, 50), Span(descriptor, 0, 5), Span(descriptor, 90, 100))
    )
    whole = bytes((*range(10, 20), *range(5), *range(90, 100)))
    assert spans.size == len(whole)
    for begin in range(len(whole) + 2):
        for count in range(len(whole) + 3):
            assert spans.read(begin, count) == whole[begin : begin + count]
    os.truncate(path, 95)
    with pytest.raises(OSError, match="shorter"):
        spans.read(0, 100)
    os.close(descriptor)
