import os
import select
from pathlib import Path

import pytest

from firmware_py.system.store import Store, StoreError


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "state")
    yield made
    made.close()


def settle(store, *names):
    """Wait for the writer to say that the saves are done; return what it said."""
    said = []
    store.when_stored(names or ("a",), said.append)
    while not said:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()
    return said


def reopened(store, directory):
    store.close()
    return Store(directory)


def test_what_was_said_to_be_stored_is_there_after_a_restart(store, tmp_path):
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


def test_the_newest_version_is_never_written_over(store, tmp_path):
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


def test_a_failure_is_said_and_heals(store, tmp_path):
    blocked = tmp_path / "state" / "a.0"
    blocked.mkdir()
    store.save("a", b"one")
    assert settle(store) == [False]
    assert "a cannot be stored" in store.failure
    blocked.rmdir()
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


def test_close_finishes_what_was_asked(tmp_path):
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
    (directory / "secret.1").write_bytes(b"")  # as somebody has copied it here, for all to read
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
    directory = tmp_path / "state"
    store = Store(directory)
    (directory / "broken.0").mkdir()
    answers = []
    for name in ("broken", "whole"):
        store.save(name, b"content")
        store.when_stored((name,), lambda well, name=name: answers.append((name, well)))
        assert select.select([store.fileno()], [], [], 10.0)[0]
        woken = os.eventfd_read(store.fileno())  # nobody looks in between
    os.eventfd_write(store.fileno(), woken)
    store.service()
    store.close()
    assert answers == [("broken", False), ("whole", True)]


def test_files_that_were_taken_away_or_replaced_under_way_are_written_anew(store, tmp_path):
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
    """The disk was full: once there is room, what is said to be stored is found after a power cut, too."""
    synced, write, sync = [], os.pwrite, os.fsync

    def noted(descriptor):
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr(os, "pwrite", lambda *_: 0)
    store.save("a", b"first")
    assert settle(store) == [False]
    assert (tmp_path / "state" / "a.0").exists()
    assert synced == []
    monkeypatch.setattr(os, "pwrite", write)
    store.save("a", b"second")
    assert settle(store) == [True]
    assert synced == [tmp_path / "state"]
