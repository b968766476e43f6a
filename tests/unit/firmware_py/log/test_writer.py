import errno
import threading
from pathlib import Path

import pytest

from firmware_py.log.writer import CHUNK_BYTES, LogWriter


class PretendDisk:
    """A disk of dictionaries, with faults to order."""

    def __init__(self):
        self.files: dict[str, bytearray] = {}
        self.open: dict[int, str] = {}
        self.made = 0
        self.room = 10**9
        self.create_error = None
        self.sync_error = None
        self.synced = 0
        self.pruned = []
        self.free = 10**9

    def create(self, directory):
        if self.create_error is not None:
            raise self.create_error
        self.made += 1
        name = f"{self.made}"
        self.files[name] = bytearray()
        self.open[self.made] = name
        return self.made, Path(name)

    def write(self, descriptor, data):
        part = bytes(data[: min(self.room, 7)])
        if not part:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= len(part)
        self.files[self.open[descriptor]] += part
        return len(part)

    def sync(self, descriptor):
        assert descriptor in self.open
        if self.sync_error is not None:
            raise self.sync_error
        self.synced += 1

    def close(self, descriptor):
        del self.open[descriptor]

    def remove(self, path):
        del self.files[str(path)]

    def prune(self, directory, room_bytes):
        self.pruned.append(room_bytes)

    def free_bytes(self, directory):
        return self.free


@pytest.fixture
def disk():
    return PretendDisk()


def writer_on(disk, **options):
    settings = {"room_bytes": 5, "queue_batches": 1000, "queue_bytes": 10**6, "flush_s": 1000.0}
    return LogWriter(Path("logs"), disk, **(settings | options))


def put(writer, *batches):
    for data in batches:
        writer.put(data.lower(), opens_file=data.isupper())


def test_batches_go_to_the_file_that_was_opened_for_them(disk):
    writer = writer_on(disk)
    put(writer, b"ONE", b"two", b"THREE", b"four")
    assert disk.files == {}
    writer.drain()
    assert disk.files == {"1": b"onetwo", "2": b"threefour"}
    assert disk.pruned == [5, 5]
    assert (writer.lost, writer.failure, writer.has_written) == (0, "", True)
    writer.close()
    assert disk.open == {}


def test_what_is_written_is_synced_and_nothing_else(disk):
    writer = writer_on(disk)
    put(writer, b"ONE")
    writer.drain()
    writer.drain()
    assert disk.synced == 1


def test_large_queues_are_written_in_pieces(disk):
    writer = writer_on(disk, queue_bytes=10 * CHUNK_BYTES)
    disk.write = lambda descriptor, data: sizes.append(len(data)) or len(data)
    sizes = []
    put(writer, b"A" * 8, *[b"b" * (CHUNK_BYTES // 2)] * 7)
    writer.drain()
    assert sum(sizes) == 8 + 7 * CHUNK_BYTES // 2
    assert max(sizes) <= 2 * CHUNK_BYTES


def test_a_full_queue_says_so_by_count_and_by_size(disk):
    writer = writer_on(disk, queue_batches=4)
    writer._thread = threading.current_thread()  # the queue is not drained
    put(writer, b"a", b"b", b"c")
    assert not writer.full()
    put(writer, b"d")
    assert writer.full()
    writer.drain()
    assert not writer.full()
    big = writer_on(disk, queue_bytes=10)
    big._thread = threading.current_thread()
    put(big, b"x" * 9)
    assert not big.full()
    put(big, b"x")
    assert big.full()


def test_a_full_disk_loses_what_does_not_fit_and_a_new_file_goes_on(disk):
    writer = writer_on(disk)
    put(writer, b"ONE")
    writer.drain()
    disk.room = 4
    put(writer, b"two", b"three", b"four")
    writer.drain()
    assert disk.files == {"1": b"onetwot"}
    assert disk.open == {}
    assert (writer.lost, writer.requested_files, writer.failure) == (2, 2, "log: No space left on device")
    put(writer, b"five")  # of the time before the loop has heard of it
    put(writer, b"SIX")
    writer.drain()
    assert disk.files == {"1": b"onetwot"}  # the file that held no whole tick is gone again
    assert (writer.lost, writer.requested_files) == (4, 3)
    disk.room = 100
    put(writer, b"SEVEN", b"eight")
    writer.drain()
    assert disk.files == {"1": b"onetwot", "3": b"seveneight"}
    assert (writer.lost, writer.requested_files, writer.failure) == (4, 3, "")


def test_a_file_that_cannot_be_made_is_tried_again_on_the_next_turn(disk):
    writer = writer_on(disk)
    disk.create_error = OSError(errno.EROFS, "Read-only file system")
    put(writer, b"ONE", b"two")
    writer.drain()
    assert (writer.lost, writer.requested_files, writer.failure) == (2, 2, "log: Read-only file system")
    assert not writer.has_written
    disk.create_error = None
    put(writer, b"THREE")
    writer.drain()
    assert disk.files == {"1": b"three"}
    assert (writer.lost, writer.failure) == (2, "")


def test_a_failed_sync_loses_all_since_the_last_good_one(disk):
    writer = writer_on(disk)
    put(writer, b"ONE")
    writer.drain()
    disk.sync_error = OSError(errno.EIO, "Input/output error")
    put(writer, b"two", b"three")
    writer.drain()
    assert (writer.lost, writer.requested_files, writer.failure) == (2, 2, "log: Input/output error")
    assert disk.files == {"1": b"onetwothree"}  # the first is surely there


def test_files_without_synced_data_are_removed(disk):
    writer = writer_on(disk)
    disk.sync_error = OSError(errno.EIO, "Input/output error")
    for name in (b"ONE", b"TWO", b"THREE"):
        put(writer, name, b"more")
        writer.drain()
    assert (writer.lost, writer.requested_files, disk.files) == (6, 4, {})


def test_the_thread_writes_all_before_it_ends(disk):
    writer = writer_on(disk)
    writer.start()
    put(writer, b"ONE", b"two")
    writer.close()
    assert disk.files == {"1": b"onetwo"}
    assert disk.open == {}
    assert writer.alive()


def test_the_thread_writes_at_intervals(disk):
    writer = writer_on(disk, flush_s=0.001)
    arrived = threading.Event()
    disk.sync = lambda descriptor: arrived.set()
    writer.start()
    put(writer, b"ONE")
    assert arrived.wait(30.0)
    assert disk.files == {"1": b"one"}
    writer.close()


def test_a_queue_half_full_wakes_the_thread(disk):
    writer = writer_on(disk, queue_batches=4)
    arrived = threading.Event()
    disk_sync = disk.sync
    disk.sync = lambda descriptor: (disk_sync(descriptor), arrived.set())
    writer.start()
    put(writer, b"ONE", b"two", b"three")
    assert arrived.wait(30.0)  # the flush would come after 1000 s
    writer.close()
    assert disk.files == {"1": b"onetwothree"}


def test_with_wait_for_disk_the_loop_waits_for_the_first_sync_and_for_space(disk):
    """In lockstep neither the log nor its health may depend on the speed of the disk."""
    writer = writer_on(disk, queue_batches=4, wait_for_disk=True)
    writer.start()
    put(writer, b"ONE")
    assert (writer.has_written, disk.files) == (True, {"1": b"one"})
    for _ in range(40):
        assert not writer.full()
        put(writer, b"two")
    writer.close()
    assert (disk.files, writer.lost) == ({"1": b"one" + 40 * b"two"}, 0)


def test_with_wait_for_disk_a_missing_disk_does_not_block(disk):
    disk.create_error = OSError(errno.EROFS, "Read-only file system")
    writer = writer_on(disk, wait_for_disk=True)
    writer.start()
    put(writer, b"ONE", b"two")
    assert (writer.has_written, writer.failure) == (False, "log: Read-only file system")
    writer.close()


def test_without_a_thread_a_queue_half_full_is_written_at_once(disk):
    writer = writer_on(disk, queue_batches=4)
    put(writer, b"ONE", b"two", b"three", b"four", b"five")
    assert disk.files["1"].startswith(b"onetwothree")
    assert not writer.full()
