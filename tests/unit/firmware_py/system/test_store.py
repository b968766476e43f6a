"""Store of the state: versions, failures, callbacks, late directories and locks."""

import errno
import fcntl
import os
import select
import threading
from pathlib import Path

import pytest
from msgspec.structs import replace

from firmware_py.common.records import Progress, Stored
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.state_export import Export, begin_import
from firmware_py.system.store import Job, Store


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "state"


@pytest.fixture
def store(directory):
    opened = Store(directory)
    yield opened
    opened.close()


def wait_for(store, condition):
    """Run the callbacks of the store until a condition is met."""
    while not condition():
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()


def is_stored(store, *names):
    """Wait for the pending saves of these names; return their result."""
    results = []
    store.when_stored(names or ("a",), results.append)
    wait_for(store, lambda: results)
    return results == [True]


def save(store, name, *contents):
    """Save versions one after another and return whether all are on disk."""
    results = []
    for content in contents:
        store.save(name, content)
        results.append(is_stored(store, name))
    return all(results)


def open_descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def test_written_versions_and_blocks_are_counted(store):
    """A new slot is written twice, first to allocate its blocks."""
    counts = [store.written]
    for content in (b"one", b"two", b"three", b"4" * 5000):
        assert save(store, "a", content)
        counts.append(store.written)
    assert counts == [(0, 0), (1, 8192), (2, 16384), (3, 20480), (4, 36864)]
    store.try_save("a", b"5", lambda _is_ok: None)
    assert store.settle()
    assert store.written == (5, 40960)


def test_saved_content_is_on_disk(store, directory):
    assert store.load("a") is None
    store.save("a", b"one")
    store.save("b", b"\x00binary\xff")
    assert is_stored(store, "a", "b")
    assert b"\none" in (directory / "a.0").read_bytes()
    assert (store.load("a"), store.load("b")) == (b"one", b"\x00binary\xff")
    assert store.examine("a") == Stored(b"one")  # the other slot is written by the second version
    assert save(store, "a", b"two")
    (directory / "a.0").unlink()
    assert store.examine("a") == Stored(b"two", "a.0 is missing")


def slot_with(directory, content):
    (slot,) = [path for path in sorted(directory.glob("a.*")) if content in path.read_bytes()]
    return slot


def test_a_damaged_newest_version_falls_back_to_the_previous_one(store, directory):
    assert save(store, "a", b"first", b"second")
    slot = slot_with(directory, b"second")
    content = slot.read_bytes()
    used = content.index(b"second") + len(b"second")
    for cut in range(used):
        for damaged in (content[:cut], content[:cut] + bytes(len(content) - cut)):
            slot.write_bytes(damaged)
            assert store.load("a") == b"first"
    for bit in range(8 * used):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        slot.write_bytes(damaged)
        assert store.load("a") == b"first"
    slot.unlink()
    assert store.load("a") == b"first"


@pytest.mark.parametrize(
    "contents",
    [[b"x" * size for size in (0, 1, 5000, 3, 200_000, 10)], [b"# rambler state 9 3 00000000\nx\0\0"]],
    ids=["lengths", "like_a_head"],
)
def test_any_content_is_read_back(store, contents):
    for content in contents:
        assert save(store, "a", content)
        assert store.load("a") == content


def test_a_failure_is_reported_and_the_next_save_succeeds(store, monkeypatch):
    def fail(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", fail)
        assert not save(store, "a", b"one")
    assert store.failure == "a cannot be stored: No space left on device"
    assert save(store, "a", b"two")
    assert store.load("a") == b"two"


def test_a_failed_save_is_repeated_after_a_pause(store, monkeypatch, no_pause):
    pwrite, failures = os.pwrite, [errno.ENOSPC, errno.EIO]

    def fail_twice(*arguments):
        if failures:
            raise OSError(failures.pop(), "failed")
        return pwrite(*arguments)

    monkeypatch.setattr(os, "pwrite", fail_twice)
    store.save("a", b"one")
    wait_for(store, lambda: store.load("a") == b"one" and not store.failure)


def test_both_slots_are_written_on_request_also_if_a_newer_version_replaces_it(store, directory, monkeypatch):
    """The second and third versions are queued while the first is being written."""
    store.save("a", b"one", both_slots=True)
    assert is_stored(store)
    assert slot_contents(directory) == {b"one"}
    is_queued, fdatasync = threading.Event(), os.fdatasync
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: (is_queued.wait(), fdatasync(descriptor)))
    store.save("b", b"first")
    while store._jobs:
        os.sched_yield()
    store.save("a", b"two", both_slots=True)
    store.save("a", b"three")
    is_queued.set()
    assert is_stored(store, "a", "b")
    assert slot_contents(directory) == {b"three"}
    store.save("a", b"other")
    assert is_stored(store)
    assert slot_contents(directory) == {b"three", b"other"}


def test_a_second_autopilot_and_an_impossible_directory_are_refused(store, directory, tmp_path):
    count = open_descriptors()
    with pytest.raises(StoreError, match="in use"):
        Store(directory)
    assert open_descriptors() == count
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="--state"):
        Store(tmp_path / "file" / "state")


@pytest.fixture
def no_pause(monkeypatch):
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)


@pytest.fixture
def stored(tmp_path):
    """Return a directory with two versions of `a`."""
    store = Store(tmp_path / "stored")
    assert save(store, "a", b"old", b"older")
    store.close()
    return tmp_path / "stored"


def slot_contents(directory):
    return {(directory / f"a.{slot}").read_bytes().split(b"\n")[1].rstrip(b"\0") for slot in (0, 1)}


def test_with_wait_saves_fail_until_the_directory_appears_and_its_newest_version_is_kept(directory, stored, no_pause):
    directory.touch()  # a file in its place
    store = Store(directory, wait=True)
    mounted, refused = [], []
    store.on_mount(("a", "b"), mounted.append)
    assert "Not a directory" in store.start_problem
    assert "Not a directory" in store.failure
    assert store.load("a") is None
    assert not save(store, "b", b"new")
    store.try_save("a", b"refused", refused.append)
    wait_for(store, lambda: refused)
    assert refused == [False]
    directory.unlink()
    stored.rename(directory)
    wait_for(store, lambda: mounted)
    (contents,) = mounted
    assert {name: version.content for name, version in contents.items()} == {"a": b"older", "b": None}
    assert is_stored(store, "b")
    assert save(store, "a", b"newest")
    assert store.failure == ""
    with pytest.raises(StoreError, match="in use"):
        Store(directory)
    store.close()
    assert slot_contents(directory) == {b"older", b"newest"}


def test_a_directory_mounted_over_the_locked_one_is_used(directory, stored, tmp_path, no_pause):
    store = Store(directory, wait=True)
    mounted = []
    store.on_mount(("a",), mounted.append)
    assert save(store, "b", b"1")
    directory.rename(tmp_path / "hidden")
    stored.rename(directory)
    assert not save(store, "b", b"2")
    wait_for(store, lambda: mounted)
    assert mounted[0]["a"].content == b"older"
    assert is_stored(store, "b")
    assert save(store, "a", b"newest")
    store.close()
    assert slot_contents(directory) == {b"older", b"newest"}
    assert not (tmp_path / "hidden" / "a.0").exists()


def test_a_removed_directory_is_not_created_again(directory, tmp_path, no_pause):
    """Its medium was removed; the path leads to another disk then."""
    store = Store(directory)
    directory.rename(tmp_path / "away")
    store.on_mount(("a",), lambda _: pytest.fail("the directory is known"))
    assert not save(store, "a", b"1")
    assert not directory.exists()
    (tmp_path / "away").rename(directory)
    wait_for(store, lambda: not store.failure)
    assert store.load("a") == b"1"
    store.close()


def test_a_directory_in_place_of_the_lock_file_is_renamed_and_another_autopilot_excluded(directory, no_pause):
    (directory / "lock").mkdir(parents=True)
    store = Store(directory, wait=True)
    assert store.start_problem == ""
    assert (directory / "lock.aside").is_dir()
    assert save(store, "a", b"1")
    with pytest.raises(StoreError, match="in use by another autopilot"):
        Store(directory, wait=True)
    store.close()
    Store(directory).close()


@pytest.mark.parametrize("has_directory", [True, False])
def test_without_its_lock_file_a_directory_is_used_only_with_wait(directory, monkeypatch, has_directory):
    def fail(*_arguments, **_options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    directory.mkdir()
    monkeypatch.setattr("firmware_py.system.directory_lock.open_regular", fail)
    if not has_directory:
        monkeypatch.setattr("firmware_py.system.directory_lock.DirectoryLock._open_directory", fail)
    with pytest.raises(StoreError, match="Read-only file system; choose another with --state"):
        Store(directory)
    store = Store(directory, wait=True)
    assert "Read-only file system" in store.start_problem
    assert save(store, "a", b"1") is has_directory
    store.close()


def test_link_in_place_of_the_lock_file_is_renamed(directory, tmp_path):
    directory.mkdir()
    (tmp_path / "outside").touch()
    (directory / "lock").symlink_to(tmp_path / "outside")
    Store(directory).close()
    assert ((directory / "lock.aside").is_symlink(), (directory / "lock").is_symlink()) == (True, False)


def test_earlier_versions_which_lock_only_the_file_are_excluded(directory):
    store = Store(directory)
    with (directory / "lock").open("w") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    store.close()
    with (directory / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with pytest.raises(StoreError, match="in use by another autopilot"):
            Store(directory, wait=True)


def test_without_a_thread_all_is_released(directory, monkeypatch):
    def fail(_thread):
        raise RuntimeError("can't start new thread")

    count = open_descriptors()
    with monkeypatch.context() as patches:
        patches.setattr(threading.Thread, "start", fail)
        with pytest.raises(RuntimeError):
            Store(directory)
    assert open_descriptors() == count
    Store(directory).close()


def link_to_outside(path):
    (path.parents[1] / "outside").write_bytes(b"# rambler state 9 1 5c9a27e1\n9")
    path.symlink_to("../outside")


def large_file(path):
    path.touch()
    os.truncate(path, 3 << 30)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (os.mkfifo, "is a pipe, not a regular file"),
        (link_to_outside, "is a symbolic link, not a regular file"),
        (large_file, "is larger than 1 MiB"),
    ],
    ids=["pipe", "link", "large"],
)
def test_an_invalid_slot_is_not_read_and_is_renamed_by_the_next_version(make, problem, directory, tmp_path):
    directory.mkdir()
    make(directory / "a.0")
    outside = tmp_path / "outside"
    outside_content = outside.read_bytes() if outside.exists() else None
    store = Store(directory)
    assert store.examine("a") == Stored(damage=f"a.0 cannot be read ({problem})")
    assert save(store, "a", b"new", b"newer")
    assert store.examine("a") == Stored(b"newer")
    assert os.path.lexists(directory / "a.0.aside")
    store.close()
    assert outside_content is None or outside.read_bytes() == outside_content


@pytest.mark.parametrize(("name", "slot_bytes"), [("a.key", 1 << 16), ("a.plan", 1 << 22), ("a.record", 1 << 20)])
def test_content_larger_than_a_slot_is_not_stored(store, name, slot_bytes):
    head_bytes = len(f"# rambler state 1 {slot_bytes} 00000000\n") - (len(str(slot_bytes)) - len(str(slot_bytes - 99)))
    assert not save(store, name, bytes(slot_bytes - head_bytes + 1))
    assert "too large" in store.failure
    assert save(store, name, bytes(slot_bytes - head_bytes))
    assert len(store.load(name)) == slot_bytes - head_bytes


def test_import_is_written_into_the_slots_at_the_start(directory, tmp_path):
    """A secret into both, so that no earlier one remains; a name without content is emptied."""
    store = Store(directory)
    assert save(store, "c.param", b"old", b"older")
    store.close()
    begin_import(directory, Export({"a.param": b"a", "b.key": b"b", "c.param": None}))
    store = Store(directory)
    assert store.start_problem == ""
    assert [store.load(name) for name in ("a.param", "b.key", "c.param")] == [b"a", b"b", None]
    store.close()
    slots = ["a.param.0", "b.key.0", "b.key.1", "c.param.0", "c.param.1", "lock"]
    assert sorted(path.name for path in directory.iterdir()) == slots
    assert all(b"\nb" in (directory / name).read_bytes() for name in slots[1:3])
    assert all((directory / name).stat().st_mode & 0o777 == 0o600 for name in slots[1:3])


def test_close_completes_the_requested_saves(directory):
    store = Store(directory)
    for number in range(50):
        store.save("a", str(number).encode())
    store.close()
    store = Store(directory)
    assert store.load("a") == b"49"
    store.close()


def test_saves_call_back_in_order(store):
    calls = []
    for number in range(20):
        store.save("a", bytes([number]))
        store.when_stored(("a",), lambda is_ok, number=number: calls.append((number, is_ok)))
    assert is_stored(store)
    assert calls == [(number, True) for number in range(20)]


def test_private_names_are_readable_only_by_the_owner(directory):
    directory.mkdir()
    (directory / "secret.1").write_bytes(b"")  # readable by all users
    (directory / "secret.1").chmod(0o644)
    store = Store(directory, private=("secret",))
    for content in (b"a long secret", b"another secret", b"none", b"none"):
        store.save("secret", content)
        store.save("open", content)
        assert is_stored(store, "secret", "open")
    store.close()
    modes = {path.name: path.stat().st_mode & 0o777 for path in directory.iterdir() if path.name != "lock"}
    assert not any(b"secret" in path.read_bytes() for path in directory.glob("secret.*"))
    assert modes == {"secret.0": 0o600, "secret.1": 0o600, "open.0": 0o640, "open.1": 0o640}


def test_a_failure_is_not_hidden_by_a_later_success(store):
    results = []
    for name, size in (("large", 2 << 20), ("small", 1)):
        store.save(name, bytes(size))
        store.when_stored((name,), lambda is_ok, name=name: results.append((name, is_ok)))
        assert select.select([store.fileno()], [], [], 10.0)[0]
        count = os.eventfd_read(store.fileno())  # `service` is not called in between
    os.eventfd_write(store.fileno(), count)
    store.service()
    assert results == [("large", False), ("small", True)]


def test_removed_or_replaced_files_are_written_again(store, directory):
    """The store keeps its files open, and data in a file without a name would be lost."""
    assert save(store, "a", b"first", b"second")
    for slot in (0, 1):
        (directory / f"a.{slot}").unlink()
    for content in (b"third", b"fourth"):
        assert save(store, "a", content)
        assert store.load("a") == content
    for slot in (0, 1):
        (directory / "copy").write_bytes((directory / f"a.{slot}").read_bytes())
        (directory / "copy").replace(directory / f"a.{slot}")
    for content in (b"fifth", b"sixth"):
        assert save(store, "a", content)
        assert store.load("a") == content


def test_close_closes_all_files(directory):
    count = open_descriptors()
    store = Store(directory, private=("b",))
    for name in ("a", "b") * 3:
        assert save(store, name, b"content")
    store.close()
    assert open_descriptors() == count


def test_the_directory_entry_of_a_new_file_is_synced_after_a_failed_first_write(store, directory, monkeypatch):
    synced, failures, fsync, fdatasync = [], [OSError(errno.EIO, os.strerror(errno.EIO))], os.fsync, os.fdatasync

    def record_sync(descriptor):
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        fsync(descriptor)

    def fail_once(descriptor):
        if failures:
            raise failures.pop()
        fdatasync(descriptor)

    monkeypatch.setattr(os, "fsync", record_sync)
    monkeypatch.setattr(os, "fdatasync", fail_once)
    assert not save(store, "a", b"first")
    assert (directory / "a.0").exists()
    assert synced == []
    assert save(store, "a", b"second")
    assert synced == [directory]


def test_progress_counts_the_saves_of_all_names(store):
    for number in range(3):
        assert save(store, "a", b"1", b"2")
        assert save(store, "b", b"1")
        assert replace(store.progress(), thread=None) == Progress("state store", has_work=False, done=3 * number + 3)
    with store._lock:
        store._queue("a", Job(b"3"))
        store._queue("a", Job(b"4"))
        assert store.progress().has_work
    assert is_stored(store)
    assert replace(store.progress(), thread=None) == Progress("state store", has_work=False, done=11)


def test_settle_waits_for_all_saves_and_reports_due_callbacks(store):
    assert not store.settle()
    results = []
    for number in range(20):
        store.save(f"a{number % 3}", b"%d" % number)
    store.when_stored(["a0", "a1", "a2"], results.append)
    assert store.settle()
    assert results == []
    store.service()
    assert results == [True]
    assert not store.settle()
    store.try_save("b/c", b"1", results.append)  # the directory b does not exist
    assert store.settle()
    store.service()
    assert results == [True, False]
