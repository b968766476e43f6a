"""Compression of closed logs: after any failed call, the complete log exists, compressed or not."""

import contextlib
import errno
import gzip
import os
import shutil
import tracemalloc

import pytest

from firmware_py.files.packed import open_log, packed_path
from firmware_py.log.archive import Span, Spans, archive_log
from firmware_py.log.disk import log_files, partial_path
from support.faulty_disk import CALLS, CUTS, KINDS, FaultyDisk

BLOCK_BYTES = 1 << 16

CONTENT = b"".join(b"heading %d, " % (number * number) for number in range(12_000))  # more than three blocks
SHORT = CONTENT[:13_000]
MODIFIED_S = 1_800_000_000
assert 3 * BLOCK_BYTES < len(CONTENT) < 4 * BLOCK_BYTES


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "00000001.BIN"
    path.write_bytes(CONTENT)
    os.utime(path, (MODIFIED_S, MODIFIED_S))
    return path


def read_content(directory):
    """Return the uncompressed content of the only log."""
    (path,) = log_files(directory).values()
    file = open_log(path)
    try:
        return file.read(0, file.size)
    finally:
        file.close()


def names(directory):
    return sorted(path.name for path in directory.iterdir())


def finish(path):
    """Compress a log in up to three attempts."""
    for _ in range(3):
        if not path.exists() or path.suffix != ".BIN":
            return
        for _ in archive_log(path):
            pass


def test_spans_are_read_as_one_file(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(bytes(range(100)))
    descriptor = os.open(path, os.O_RDONLY)
    spans = Spans(
        (Span(descriptor, 10, 20), Span(descriptor, 50, 50), Span(descriptor, 0, 5), Span(descriptor, 90, 100))
    )
    expected = bytes((*range(10, 20), *range(5), *range(90, 100)))
    assert spans.size == len(expected)
    for begin in range(len(expected) + 2):
        for count in range(len(expected) + 3):
            assert spans.read(begin, count) == expected[begin : begin + count]
    os.truncate(path, 95)
    with pytest.raises(OSError, match="shorter"):
        spans.read(0, 100)
    os.close(descriptor)


def test_a_log_is_replaced_by_an_archive_that_gzip_reads(log):
    for _ in archive_log(log):
        assert read_content(log.parent) == CONTENT  # at every step
    assert names(log.parent) == ["00000001.BIN.gz"]
    assert gzip.decompress(packed_path(log).read_bytes()) == CONTENT
    assert packed_path(log).stat().st_mtime == MODIFIED_S
    assert packed_path(log).stat().st_size < len(CONTENT) / 2


def test_a_block_is_written_in_any_number_of_pieces(log, monkeypatch):
    pwrite, pieces = os.pwrite, []

    def write_piece(descriptor, data, offset):
        pieces.append(offset)
        assert len(pieces) < 500, "the data are written again"
        return pwrite(descriptor, data[:1000], offset)

    monkeypatch.setattr(os, "pwrite", write_piece)
    finish(log)
    assert read_content(log.parent) == CONTENT


def test_memory_does_not_depend_on_the_length_of_the_log(log):
    log.write_bytes(bytes(40 * BLOCK_BYTES))
    tracemalloc.start()
    try:
        finish(log)
        _, max_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert max_bytes < 8 * BLOCK_BYTES  # of which zlib uses four


def test_steps_and_syncs_of_forty_blocks(log, monkeypatch):
    """A step for each block, and for each eight that are compared; the archive is synced after each 16 blocks."""
    log.write_bytes(bytes(40 * BLOCK_BYTES))
    syncs, steps = [], 0
    monkeypatch.setattr(os, "fdatasync", lambda _descriptor: syncs.append(steps))
    for _ in archive_log(log):
        steps += 1
    assert (steps, syncs) == (45, [15, 31])


def test_a_log_that_is_too_large_for_an_index_stays(log, monkeypatch):
    monkeypatch.setattr("firmware_py.log.archive.MAX_BLOCKS", 4)
    log.write_bytes(bytes(4 * BLOCK_BYTES + 1))
    with pytest.raises(OSError, match="too large to be compressed"):
        finish(log)
    log.write_bytes(bytes(4 * BLOCK_BYTES))
    finish(log)
    assert names(log.parent) == ["00000001.BIN.gz"]


def test_an_empty_log_is_archived(log):
    log.write_bytes(b"")
    finish(log)
    assert read_content(log.parent) == b""


@pytest.mark.parametrize("steps", range(6))
def test_archiving_continues_after_a_kill(log, steps):
    job = archive_log(log)
    for _ in range(steps):
        next(job)
    job.close()  # closes the descriptors and leaves the files as a kill does
    partial = partial_path(packed_path(log)).read_bytes()[: 1 << 16] if steps else b""
    offsets = []
    pwrite = os.pwrite

    def record_offset(descriptor, data, offset):
        offsets.append(offset)
        return pwrite(descriptor, data, offset)

    with pytest.MonkeyPatch.context() as patches:
        patches.setattr(os, "pwrite", record_offset)
        finish(log)
    assert read_content(log.parent) == CONTENT
    assert packed_path(log).read_bytes().startswith(partial)
    # Whole blocks are not written again; the last, shorter block and the index are.
    assert len(offsets) == 5 - min(steps, 3)


def test_a_partial_archive_of_another_log_is_discarded(log):
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
    assert read_content(log.parent) == CONTENT


def test_while_both_files_exist_only_the_log_is_listed(log):
    content = log.read_bytes()
    finish(log)
    log.write_bytes(content)
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
    def fail(_descriptor, _data, _offset):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", fail)
        with pytest.raises(OSError, match="No space"):
            finish(log)
    assert log.read_bytes() == CONTENT
    finish(log)
    assert read_content(log.parent) == CONTENT


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_of_any_call_loses_no_data(tmp_path, kind, monkeypatch):
    """Each call fails once; checked are the disk after the error and after a power cut."""
    for module in ("files.packed", "log.archive"):
        monkeypatch.setattr(f"firmware_py.{module}.BLOCK_BYTES", 4096)
    number, failed, was_reached = -1, set(), True
    while was_reached:
        number += 1
        directory = tmp_path / f"{kind}{number}"
        directory.mkdir()
        log = directory / "00000001.BIN"
        log.write_bytes(SHORT)
        with monkeypatch.context() as patches:
            disk = FaultyDisk(directory, patches)
            disk.durable[log.name], disk.names[log.name] = SHORT, None
            disk.arm(number, kind)
            with contextlib.suppress(OSError):
                finish(log)
            failed.update(disk.failed)
            was_reached = bool(disk.failed)
            disk.arm(None)
            for cut in CUTS:
                disk.cut(tmp_path / f"{kind}{number}{cut}", cut)
        for state_directory in (directory, *(tmp_path / f"{kind}{number}{cut}" for cut in CUTS)):
            assert read_content(state_directory) == SHORT
            (remaining,) = log_files(state_directory).values()
            for _ in range(2):  # the first attempt removes a partial archive that the power cut damaged
                with contextlib.suppress(OSError):
                    finish(remaining)
            assert read_content(state_directory) == SHORT
            assert names(state_directory) == ["00000001.BIN.gz"]
            shutil.rmtree(state_directory)
    assert {"open", "pwrite", "fsync", "rename", "unlink", "ftruncate", "close"} - failed == set()
    assert set(CALLS) >= failed
