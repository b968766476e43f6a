"""Queue and background writer of the log: files, errors, and when the loop waits."""

import errno
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.log.writer import LogWriter

CHUNK_BYTES = 1 << 18

NO_SPACE = OSError(errno.ENOSPC, "No space left on device")
READ_ONLY = OSError(errno.EROFS, "Read-only file system")
IO_ERROR = OSError(errno.EIO, "Input/output error")


class FakeDisk:
    """A disk in memory that raises the errors assigned to it and writes at most 7 bytes per call."""

    def __init__(self):
        self.files: dict[str, bytearray] = {}
        self.open: dict[int, str] = {}
        self.created = 0
        self.capacity, self.free = 20_000, 10**9
        self.create_error = self.sync_error = None
        self.sync_count = 0
        self.pruned = []

    def create(self, directory):
        if self.create_error is not None:
            raise self.create_error
        self.created += 1
        name = f"{self.created}"
        self.files[name] = bytearray()
        self.open[self.created] = name
        return self.created, Path(name)

    def write(self, descriptor, data):
        part = bytes(data[: min(self.capacity, 7)])
        if not part:
            raise NO_SPACE
        self.capacity -= len(part)
        self.files[self.open[descriptor]] += part
        return len(part)

    def sync(self, descriptor):
        assert descriptor in self.open
        if self.sync_error is not None:
            raise self.sync_error
        self.sync_count += 1

    def close(self, descriptor):
        del self.open[descriptor]

    def remove(self, path):
        del self.files[str(path)]

    def prune(self, directory, max_log_bytes):
        self.pruned.append(max_log_bytes)

    def free_bytes(self, directory):
        return self.free


@pytest.fixture
def disk():
    return FakeDisk()


def make_writer(disk, **options):
    settings = {"max_log_bytes": 5, "queue_batches": 1000, "queue_bytes": 10**6, "flush_s": 1000.0}
    return LogWriter(Path("logs"), disk, **(settings | options))


def put(writer, *batches):
    """Queue batches; one in capitals opens a file."""
    for data in batches:
        writer.put(data.lower(), opens_file=data.isupper())


def drain(writer, *batches):
    """Queue and write batches; return the counters and the error text."""
    put(writer, *batches)
    writer.drain()
    return writer.lost, writer.requested_files, writer.failure


def test_batches_are_written_and_synced_once_to_the_file_opened_for_them(disk):
    writer = make_writer(disk)
    put(writer, b"ONE", b"two", b"THREE", b"four")
    assert disk.files == {}
    assert drain(writer) == (0, 1, "")
    assert disk.files == {"1": b"onetwo", "2": b"threefour"}
    assert disk.pruned == [5, 5]
    assert writer.has_written
    synced = disk.sync_count
    drain(writer)
    assert disk.sync_count == synced == 2  # one for each file
    writer.close()
    assert disk.open == {}


def test_large_queues_are_written_in_pieces(disk):
    writer = make_writer(disk, queue_bytes=10 * CHUNK_BYTES)
    sizes = []
    disk.write = lambda descriptor, data: sizes.append(len(data)) or len(data)
    drain(writer, b"A" * 8, *[b"b" * (CHUNK_BYTES // 2)] * 7)
    assert sizes == [8 + 262_144, 262_144, 262_144, 131_072]


@pytest.mark.parametrize(
    ("limit", "batches", "last_batch"),
    [({"queue_batches": 4}, (b"a", b"b", b"c"), b"d"), ({"queue_bytes": 10}, (b"x" * 9,), b"x")],
    ids=["batches", "bytes"],
)
def test_queue_is_full_at_its_limit(disk, limit, batches, last_batch):
    writer = make_writer(disk, **limit)
    writer._thread = threading.current_thread()  # the queue is not drained
    writer._work_done = None  # so the loop cannot wait
    put(writer, *batches)
    assert not writer.is_full()
    put(writer, last_batch)
    assert writer.is_full()
    writer.drain()
    assert not writer.is_full()


def test_full_disk_loses_batches_until_a_new_file_can_be_written(disk):
    writer = make_writer(disk)
    drain(writer, b"ONE")
    disk.capacity = 4
    assert drain(writer, b"two", b"three", b"four") == (2, 2, "log: No space left on device")
    assert disk.files == {"1": b"onetwot"}
    assert disk.open == {}
    # The loop queues one batch before it reads `requested_files`.
    assert drain(writer, b"five", b"SIX") == (4, 3, "log: No space left on device")
    assert disk.files == {"1": b"onetwot"}  # the file without a whole tick is removed
    disk.capacity = 100
    assert drain(writer, b"SEVEN", b"eight") == (4, 3, "")
    assert disk.files == {"1": b"onetwot", "3": b"seveneight"}


def test_failed_creation_is_repeated_with_the_next_file(disk):
    writer = make_writer(disk)
    disk.create_error = READ_ONLY
    assert drain(writer, b"ONE", b"two") == (2, 2, "log: Read-only file system")
    assert not writer.has_written
    disk.create_error = None
    assert drain(writer, b"THREE") == (2, 2, "")
    assert disk.files == {"1": b"three"}


def test_failed_sync_loses_the_batches_since_the_last_sync(disk):
    writer = make_writer(disk)
    drain(writer, b"ONE")
    disk.sync_error = IO_ERROR
    assert drain(writer, b"two", b"three") == (2, 2, "log: Input/output error")
    assert disk.files == {"1": b"onetwothree"}  # the first batch is synced, so the file stays


def test_files_without_synced_data_are_removed(disk):
    writer = make_writer(disk)
    disk.sync_error = IO_ERROR
    for name in (b"ONE", b"TWO", b"THREE"):
        drain(writer, name, b"more")
    assert (writer.lost, writer.requested_files, disk.files) == (6, 4, {})


class ImmediateWake:
    """Replaces the wake event of the writer: `set` calls `work` at once instead of waking the thread."""

    def __init__(self, writer):
        self.writer, self.calls = writer, 0

    def set(self):
        self.calls += 1
        assert self.calls < 9, "the loop waits without end"
        self.writer.work()


@pytest.mark.parametrize(
    ("is_alive", "batches", "calls"), [(True, (b"ONE", b"two", b"three"), [1, 0, 0]), (False, (b"ONE",), [0])]
)
def test_the_loop_waits_for_the_first_batch_only_and_not_for_a_dead_thread(disk, is_alive, batches, calls):
    writer = make_writer(disk, wait_for_disk=True)
    writer._wake, writer._thread = ImmediateWake(writer), SimpleNamespace(is_alive=lambda: is_alive)
    for batch, expected in zip(batches, calls, strict=True):
        writer._wake.calls = 0
        put(writer, batch)
        assert writer._wake.calls == expected


def test_the_loop_waits_for_a_full_queue_but_not_for_a_failed_disk(disk):
    writer = make_writer(disk, wait_for_disk=True, queue_batches=1)
    writer._wake, writer._thread = ImmediateWake(writer), SimpleNamespace(is_alive=lambda: True)
    disk.create_error = READ_ONLY
    put(writer, b"ONE", b"two")
    assert (writer._wake.calls, writer.is_full(), writer.lost) == (2, False, 2)


def test_close_waits_until_the_thread_has_written_the_queue(disk):
    writer = make_writer(disk)
    writer.start()
    put(writer, b"ONE", b"two")
    writer.close()
    assert (disk.files, disk.open) == ({"1": b"onetwo"}, {})
    assert writer.is_alive()


@pytest.mark.parametrize(
    ("options", "batches"),
    [({"flush_s": 0.001}, (b"ONE",)), ({"queue_batches": 4}, (b"ONE", b"two", b"three"))],
    ids=["interval", "half_full_queue"],
)
def test_thread_writes_at_intervals_and_when_the_queue_is_half_full(disk, options, batches):
    writer = make_writer(disk, **options)
    synced = threading.Event()
    disk.sync = lambda _descriptor: synced.set()
    writer.start()
    put(writer, *batches)
    assert synced.wait(30.0)
    writer.close()
    assert disk.files == {"1": b"".join(batches).lower()}


def test_with_wait_for_disk_the_loop_waits_for_the_first_sync_and_for_space(disk):
    """In lockstep, the log and its health must not depend on the speed of the disk."""
    writer = make_writer(disk, queue_batches=4, wait_for_disk=True)
    writer.start()
    put(writer, b"ONE")
    assert (writer.has_written, disk.files) == (True, {"1": b"one"})
    for _ in range(40):
        assert not writer.is_full()
        put(writer, b"two")
    writer.close()
    assert (disk.files, writer.lost) == ({"1": b"one" + 40 * b"two"}, 0)


def test_with_wait_for_disk_a_missing_disk_does_not_block(disk):
    disk.create_error = READ_ONLY
    writer = make_writer(disk, wait_for_disk=True)
    writer.start()
    put(writer, b"ONE", b"two")
    assert (writer.has_written, writer.failure) == (False, "log: Read-only file system")
    writer.close()


@pytest.mark.parametrize(
    ("limits", "batches", "drained"),
    [
        ({"queue_batches": 4}, (b"ONE", b"two"), False),
        ({"queue_batches": 4}, (b"ONE", b"two", b"three"), True),
        ({"queue_bytes": 10}, (b"A" * 5,), False),
        ({"queue_bytes": 10}, (b"A" * 6,), True),
    ],
)
def test_a_queue_that_is_more_than_half_full_is_written(disk, limits, batches, drained):
    writer = make_writer(disk, **limits)
    put(writer, *batches)
    assert (disk.files == {"1": b"".join(batches).lower()}) is drained
    writer = make_writer(disk, **limits)
    writer._wake, writer._thread = ImmediateWake(writer), threading.current_thread()
    put(writer, *batches)
    assert writer._wake.calls == int(drained)


def test_the_loop_waits_at_most_ten_seconds_for_a_blocked_disk(disk):
    writer, waits_s = make_writer(disk, wait_for_disk=True), []
    thread = SimpleNamespace(is_alive=lambda: True, join=waits_s.append)
    writer._thread, writer._work_done = thread, SimpleNamespace(clear=lambda: None, wait=waits_s.append)
    put(writer, b"ONE")
    writer.close()
    assert waits_s == [10.0, 10.0]


def test_progress_is_that_of_the_running_thread(disk):
    writer = make_writer(disk)
    assert writer.progress() == ()
    writer.start()
    (progress,) = writer.progress()
    assert (progress.name, progress.has_work, progress.done, progress.alive) == ("log", True, 0, True)
    writer._closing = True
    assert writer.progress() == ()
    writer.close()


def test_without_a_thread_a_half_full_queue_is_written_at_once(disk):
    writer = make_writer(disk, queue_batches=4)
    put(writer, b"ONE", b"two", b"three", b"four", b"five")
    assert disk.files["1"].startswith(b"onetwothree")
    assert not writer.is_full()
