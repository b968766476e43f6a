import errno
import fcntl
import os
import select
import threading
from pathlib import Path

import pytest

from firmware_py.common.records import Stored
from firmware_py.system.store import Store, StoreError


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "state")
    yield made
    made.close()


def settle(store, *names):
    """Wait for the writer to say that the saves are done; return what it said."""
    results = []
    store.when_stored(names or ("a",), results.append)
    while not results:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()
    return results


def reopened(store, directory):
    store.close()
    return Store(directory)


def test_saved_content_is_there_after_a_restart(store, tmp_path):
    assert store.load("a") is None
    store.save("a", b"one")
    store.save("b", b"\x00binary\xff")
    assert settle(store, "a", "b") == [True]
    # Read past the object: it is on the disk, not in its memory.
    assert b"\none" in (tmp_path / "state" / "a.0").read_bytes()
    assert (store.load("a"), store.load("b")) == (b"one", b"\x00binary\xff")


def newest_slot(store, directory, name, content):
    (slot,) = [path for path in sorted(directory.glob(f"{name}.*")) if content in path.read_bytes()]
    return slot


def test_a_broken_newest_version_falls_back_to_the_one_before(store, tmp_path):
    for content in (b"first", b"second"):
        store.save("a", content)
        settle(store)
    file = newest_slot(store, tmp_path / "state", "a", b"second")
    whole = file.read_bytes()
    for cut in range(whole.index(b"second") + len(b"second")):
        file.write_bytes(whole[:cut])
        assert store.load("a") == b"first"
        file.write_bytes(whole[:cut] + bytes(len(whole) - cut))
        assert store.load("a") == b"first"
    for bit in range(8 * (whole.index(b"second") + len(b"second"))):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        file.write_bytes(changed)
        assert store.load("a") == b"first"
    file.unlink()
    assert store.load("a") == b"first"


def test_the_newest_version_is_not_overwritten(store, tmp_path):
    for number in range(20):
        before = store.load("a")
        untouched = None if before is None else newest_slot(store, tmp_path / "state", "a", b"<" + before[1:-1] + b">")
        stamp = None if untouched is None else untouched.read_bytes()
        store.save("a", b"<%d>" % number)
        settle(store)
        assert store.load("a") == b"<%d>" % number
        if untouched is not None:
            assert untouched.read_bytes() == stamp
    assert len(list((tmp_path / "state").glob("a.*"))) == 2


def test_versions_of_any_length_follow_each_other(store):
    for length in (0, 1, 5000, 3, 200_000, 10):
        store.save("a", b"x" * length)
        settle(store)
        assert store.load("a") == b"x" * length


def test_content_that_looks_like_a_head_is_safe(store):
    tricky = b"# rambler state 9 3 00000000\nx\0\0"
    store.save("a", tricky)
    settle(store)
    assert store.load("a") == tricky


def no_room(*_words):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_failure_is_reported_and_recovers(store, monkeypatch):
    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", no_room)
        store.save("a", b"one")
        assert settle(store) == [False]
    assert "a cannot be stored" in store.failure
    store.save("a", b"two")
    assert settle(store) == [True]
    assert store.load("a") == b"two"


def test_a_second_autopilot_is_refused(store, tmp_path):
    with pytest.raises(StoreError, match="in use"):
        Store(tmp_path / "state")


def test_a_directory_that_cannot_be_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="--state"):
        Store(tmp_path / "file" / "state")


def until_arrived(store, welcomed):
    while not welcomed:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()


def stored_before(directory):
    before = Store(directory)
    for content in (b"old", b"older"):
        before.save("a", content)
        settle(before)
    before.close()


@pytest.fixture
def no_pause(monkeypatch):
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)


def test_who_waits_for_the_directory_is_refused_until_it_is_there_and_nothing_in_it_is_lost(tmp_path, no_pause):
    stored_before(tmp_path / "kept")
    (tmp_path / "state").touch()  # in the way
    store = Store(tmp_path / "state", wait=True)
    welcomed = []
    store.on_mount(("a", "b"), welcomed.append)
    assert "Not a directory" in store.start_problem
    assert "Not a directory" in store.failure
    assert store.load("a") is None
    store.save("b", b"new")
    assert settle(store, "b") == [False]
    refused = []
    store.try_save("a", b"refused", refused.append)
    while not refused:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()
    assert refused == [False]
    (tmp_path / "state").unlink()
    (tmp_path / "kept").rename(tmp_path / "state")
    until_arrived(store, welcomed)
    assert [{name: stored.content for name, stored in found.items()} for found in welcomed] == [
        {"a": b"older", "b": None}
    ]
    assert settle(store, "b") == [True]
    store.save("a", b"newest")
    assert settle(store) == [True]
    assert store.failure == ""
    with pytest.raises(StoreError, match="in use"):
        Store(tmp_path / "state")
    store.close()
    assert stored_before_and_now(tmp_path / "state") == {b"older", b"newest"}


def stored_before_and_now(directory):
    """Return the content of both slots: the newest is not overwritten."""
    return {(directory / f"a.{slot}").read_bytes().split(b"\n")[1].rstrip(b"\0") for slot in (0, 1)}


def test_a_directory_put_in_place_of_the_one_that_was_held_is_taken_up_too(tmp_path, no_pause):
    """As one on a medium that is mounted late over an empty one."""
    stored_before(tmp_path / "mounted")
    store = Store(tmp_path / "state", wait=True)
    welcomed = []
    store.on_mount(("a",), welcomed.append)
    store.save("b", b"1")
    assert settle(store, "b") == [True]
    (tmp_path / "state").rename(tmp_path / "hidden")
    (tmp_path / "mounted").rename(tmp_path / "state")
    store.save("b", b"2")
    assert settle(store, "b") == [False]
    until_arrived(store, welcomed)
    assert welcomed[0]["a"].content == b"older"
    assert settle(store, "b") == [True]
    store.save("a", b"newest")
    assert settle(store) == [True]
    store.close()
    assert stored_before_and_now(tmp_path / "state") == {b"older", b"newest"}
    assert not (tmp_path / "hidden" / "a.0").exists()


def test_a_removed_directory_is_not_created_again(tmp_path, no_pause):
    """It was on a medium: below the place where that was mounted there is another disk."""
    store = Store(tmp_path / "state")
    (tmp_path / "state").rename(tmp_path / "away")
    store.save("a", b"1")
    store.on_mount(("a",), lambda _: pytest.fail("it is known"))
    assert settle(store) == [False]
    assert not (tmp_path / "state").exists()
    (tmp_path / "away").rename(tmp_path / "state")
    while store.failure:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()
    assert store.load("a") == b"1"
    store.close()


def test_another_autopilot_is_excluded_even_with_wait(tmp_path, no_pause):
    """Also where a directory lay in the place of the lock file: it is set aside."""
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "lock").mkdir()
    first = Store(tmp_path / "state", wait=True)
    assert first.start_problem == ""
    assert (tmp_path / "state" / "lock.aside").is_dir()
    first.save("a", b"1")
    assert settle(first) == [True]
    with pytest.raises(StoreError, match="in use by another autopilot"):
        Store(tmp_path / "state", wait=True)
    first.close()
    Store(tmp_path / "state").close()


def test_the_version_before_is_kept_out_by_the_file_and_keeps_out(tmp_path):
    """It locks the file only."""
    store = Store(tmp_path / "state")
    with (tmp_path / "state" / "lock").open("w") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    store.close()
    with (tmp_path / "state" / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with pytest.raises(StoreError, match="in use by another autopilot"):
            Store(tmp_path / "state", wait=True)


def test_no_thread_leaves_nothing_held(tmp_path, monkeypatch):
    def start(_thread):
        raise RuntimeError("can't start new thread")

    before = len(list(Path("/proc/self/fd").iterdir()))
    with monkeypatch.context() as patches:
        patches.setattr(threading.Thread, "start", start)
        with pytest.raises(RuntimeError):
            Store(tmp_path / "state")
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    Store(tmp_path / "state").close()


def gigabytes(path):
    path.touch()
    os.truncate(path, 3 << 30)


def linked_out(path):
    (path.parents[1] / "outside").write_bytes(b"# rambler state 9 1 5c9a27e1\n9")
    path.symlink_to("../outside")


ODD = {
    os.mkfifo: "is a pipe, not a regular file",
    linked_out: "is a symbolic link, not a regular file",
    gigabytes: "is larger than 1 MiB",
}


@pytest.mark.parametrize("make", ODD, ids=lambda make: make.__name__)
def test_a_slot_that_is_no_file_is_not_read_and_is_set_aside_by_the_next_version(make, tmp_path):
    (tmp_path / "state").mkdir()
    make(tmp_path / "state" / "a.0")
    outside = (tmp_path / "outside").read_bytes() if make is linked_out else b""
    store = Store(tmp_path / "state")
    found = store.examine("a")
    assert (found.content, found.damage) == (None, f"a.0 cannot be read ({ODD[make]})")
    for content in (b"new", b"newer"):
        store.save("a", content)
        assert settle(store) == [True]
    assert store.examine("a") == Stored(b"newer")
    assert os.path.lexists(tmp_path / "state" / "a.0.aside")
    store.close()
    if make is linked_out:
        assert (tmp_path / "outside").read_bytes() == outside


def test_what_would_be_too_large_to_be_read_is_not_stored(store):
    store.save("a.key", b"k" * (64 << 10))
    assert settle(store, "a.key") == [False]
    assert "too large" in store.failure


def test_close_finishes_what_was_requested(tmp_path):
    store = Store(tmp_path / "state")
    for number in range(50):
        store.save("a", str(number).encode())
    store.close()
    again = Store(tmp_path / "state")
    assert again.load("a") == b"49"
    again.close()


def test_many_saves_call_back_in_order(store):
    called = []
    for number in range(20):
        store.save("a", bytes([number]))
        store.when_stored(("a",), lambda well, number=number: called.append((number, well)))
    settle(store)
    assert called == [(number, True) for number in range(20)]


def test_what_is_private_is_for_the_owner_alone(tmp_path):
    directory = tmp_path / "state"
    directory.mkdir()
    (directory / "secret.1").write_bytes(b"")  # a copy that all users can read
    (directory / "secret.1").chmod(0o644)
    store = Store(directory, private=("secret",))
    try:
        for content in (b"a long secret", b"another secret", b"none", b"none"):
            store.save("secret", content)
            store.save("open", content)
            settle(store, "secret", "open")
    finally:
        store.close()
    modes = {path.name: path.stat().st_mode & 0o777 for path in directory.iterdir() if path.name != "lock"}
    assert not any(b"secret" in path.read_bytes() for path in directory.glob("secret.*"))
    assert modes == {"secret.0": 0o600, "secret.1": 0o600, "open.0": 0o640, "open.1": 0o640}


def test_a_failure_is_not_hidden_by_a_later_success(tmp_path):
    store = Store(tmp_path / "state")
    answers = []
    for name in ("broken", "whole"):
        store.save(name, bytes(2 << 20 if name == "broken" else 1))  # the first is too large
        store.when_stored((name,), lambda well, name=name: answers.append((name, well)))
        assert select.select([store.fileno()], [], [], 10.0)[0]
        woken = os.eventfd_read(store.fileno())  # not read in between
    os.eventfd_write(store.fileno(), woken)
    store.service()
    store.close()
    assert answers == [("broken", False), ("whole", True)]


def test_removed_or_replaced_files_are_written_again(store, tmp_path):
    """They stay open, so what is written to one that has no name any more would be lost."""
    directory = tmp_path / "state"
    for content in (b"first", b"second"):
        store.save("a", content)
        settle(store)
    for slot in (0, 1):
        (directory / f"a.{slot}").unlink()
    for content in (b"third", b"fourth"):
        store.save("a", content)
        assert settle(store) == [True]
        assert store.load("a") == content
    for slot in (0, 1):
        (directory / "copy").write_bytes((directory / f"a.{slot}").read_bytes())
        (directory / "copy").replace(directory / f"a.{slot}")
    for content in (b"fifth", b"sixth"):
        store.save("a", content)
        assert settle(store) == [True]
        assert store.load("a") == content


def test_all_its_files_are_closed_in_the_end(tmp_path):
    before = len(list(Path("/proc/self/fd").iterdir()))
    made = Store(tmp_path / "state", private=("b",))
    for name in ("a", "b") * 3:
        made.save(name, b"content")
        assert settle(made, name) == [True]
    made.close()
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_the_name_of_a_new_file_reaches_the_disk_though_its_first_content_did_not(store, tmp_path, monkeypatch):
    """The disk was ill: once it is well, what is said to be stored is found after a power cut, too."""
    synced, failures, sync, sync_data = [], [OSError(errno.EIO, os.strerror(errno.EIO))], os.fsync, os.fdatasync

    def noted(descriptor):
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        sync(descriptor)

    def fails_once(descriptor):
        if failures:
            raise failures.pop()
        sync_data(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr(os, "fdatasync", fails_once)
    store.save("a", b"first")
    assert settle(store) == [False]
    assert (tmp_path / "state" / "a.0").exists()
    assert synced == []
    store.save("a", b"second")
    assert settle(store) == [True]
    assert synced == [tmp_path / "state"]


def test_what_finds_no_room_leaves_no_file_without_a_byte(store, tmp_path, monkeypatch):
    """The next start would take it for one that the card has lost."""
    monkeypatch.setattr(os, "pwrite", lambda *_: 0)
    store.save("a", b"first")
    assert settle(store) == [False]
    assert not (tmp_path / "state" / "a.0").exists()


def test_writes_are_counted_in_blocks_as_a_disk_takes_them(store, tmp_path):
    assert store.written == (0, 0)
    store.save("a", b"1")
    settle(store, "a")
    assert store.written == (1, 2 * 4096)  # room is made first
    for number in range(3):
        store.save("a", b"%d" % number)
        settle(store, "a")
    assert store.written == (4, 6 * 4096)
    store.save("a", bytes(5000))
    settle(store, "a")
    assert store.written == (5, 10 * 4096)
    store.try_save("a", b"2", lambda _well: None)
    assert store.settle()
    assert store.written == (6, 11 * 4096)


def test_what_is_requested_for_is_settled_when_time_may_go_on(store, tmp_path):
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
    store.try_save("b/c", b"1", results.append)  # there is no such directory
    assert store.settle()
    store.service()
    assert results == [True, False]
