"""The signing key never fails open: whatever the disk does, a key that was set is there, or known to be lost."""

import errno
import itertools
import os
import select
import shutil
import stat

import pytest

from firmware_py.common.records import Stored
from firmware_py.link.signing import KeyRecord, KeyState, find_key, to_text
from firmware_py.system.slots import slot_path
from firmware_py.system.state_directory import SIGNING_FILE, KeyVault, exposed_key_files, stored_key
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sampled

OLD, NEW = (to_text(KeyRecord(bytes(32 * [number]), 10**13, {(255, 190, 0): 10**13})) for number in (7, 9))
OLD_SECRET = bytes(32 * [7]).hex().encode()
REMOVED = b""
ABSENT, PRESENT, LOST = KeyState


def vault_of(directory):
    return KeyVault(Store(directory, private=(SIGNING_FILE,)))


def keep(vault, content, *, both_slots=True):
    """Save as the link does; return whether it is on disk."""
    answers = []
    vault.save(content, both_slots=both_slots)
    vault.when_stored(answers.append)
    while not answers:
        assert select.select([vault.store.fileno()], [], [], 10.0)[0]
        vault.store.service()
    return answers[0]


def kept(directory, *contents):
    """Save one after the other in runs of their own."""
    for content in contents:
        vault = vault_of(directory)
        assert keep(vault, content)
        vault.store.close()


def slots(directory):
    return [slot_path(directory, SIGNING_FILE, number) for number in (0, 1)]


def found(directory):
    return find_key(stored_key(directory))


def emptied(directory):
    for path in slots(directory):
        path.write_bytes(b"")


def spoiled(directory):
    for path in slots(directory):
        path.write_bytes(path.read_bytes()[:40])


def half_spoiled(directory):
    slots(directory)[0].write_bytes(b"")


# how it was before -> the state that is found then
BEFORE = {
    "never set": (lambda _directory: None, ABSENT),
    "removed": (lambda directory: kept(directory, OLD, REMOVED), ABSENT),
    "set": (lambda directory: kept(directory, OLD), PRESENT),
    "set with one slot damaged": (lambda directory: (kept(directory, OLD), half_spoiled(directory)), PRESENT),
    "lost by files without a byte": (lambda directory: (kept(directory, OLD), emptied(directory)), LOST),
    "lost by damage": (lambda directory: (kept(directory, OLD), spoiled(directory)), LOST),
    "removed with one slot damaged": (lambda directory: (kept(directory, REMOVED), half_spoiled(directory)), LOST),
}
ACTS = {"set": (NEW, True), "timestamps": (OLD, False), "remove": (REMOVED, True)}
FAULTS = [(kind, lasting) for kind in KINDS for lasting in (False, True)]


def allowed(act, state, *, stored):
    """The states that the next start may find."""
    if act == "remove":
        return {ABSENT} if stored else {state, ABSENT, LOST}
    if stored:
        return {PRESENT}
    return {PRESENT, LOST} if state is not ABSENT else {ABSENT, PRESENT, LOST}


def judge(act, prepared, state, folder, monkeypatch, at, kind, *, lasting):
    """Do one act on a failing disk; return the number of its calls."""
    content, both_slots = ACTS[act]
    shutil.copytree(prepared, folder / "state")
    with monkeypatch.context() as patches:
        patches.setattr("firmware_py.system.store.RETRY_S", 1000.0)
        disk = FaultyDisk(folder / "state", patches)
        for path in disk.directory.iterdir():
            disk.named[path.name], disk.durable[path.name] = None, path.read_bytes()
        vault = vault_of(disk.directory)
        disk.arm(at, kind, lasting=lasting)
        stored = keep(vault, content, both_slots=both_slots)
        failed, calls = list(disk.failed), disk.count
        with disk.still:
            shutil.copytree(disk.directory, folder / "killed")
            for pattern in CUTS:
                disk.cut(folder / pattern, pattern)
        disk.arm(None)
        vault.store.close()
    for image in [folder / name for name in ("killed", *CUTS)]:
        assert found(image).state in allowed(act, state, stored=stored), (image.name, failed, stored)
        if act != "timestamps" and stored:
            assert not any(OLD_SECRET in path.read_bytes() for path in slots(image)), "the old key is still there"
    # The disk works again: what was asked for is there, and of the old key nothing.
    last = found(folder / "state")
    assert last.state is (ABSENT if act == "remove" else PRESENT)
    if act != "timestamps":
        assert not any(OLD_SECRET in path.read_bytes() for path in slots(folder / "state"))
    return calls


# The timestamps are those of a key; to remove what is not there is of no danger.
CASES = [
    (act, before)
    for act in ACTS
    for before, (_, state) in BEFORE.items()
    if state in {"set": KeyState, "timestamps": (PRESENT,), "remove": (PRESENT, LOST)}[act]
]


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.proof)], ids=["sampled", "every"])
@pytest.mark.parametrize(("act", "before"), CASES)
def test_at_a_failing_call_a_key_that_was_set_does_not_turn_into_none(act, before, every, tmp_path, monkeypatch):
    prepare, state = BEFORE[before]
    prepared = tmp_path / "prepared"
    prepared.mkdir()
    prepare(prepared)
    assert found(prepared).state is state

    def calls_of(at, kind, *, lasting):
        folder = tmp_path / "case"
        folder.mkdir()
        calls = judge(act, prepared, state, folder, monkeypatch, at, kind, lasting=lasting)
        shutil.rmtree(folder)
        return calls

    cases, calls = 0, calls_of(None, "refused", lasting=False)
    for kind, lasting in FAULTS:
        for at in itertools.count() if every else sampled(calls, 2, f"{act} {before} {kind} {lasting}"):
            if calls_of(at, kind, lasting=lasting) <= at:
                break
            cases += 1
    assert cases >= 2 * len(FAULTS)


@pytest.mark.parametrize("other", ["whole", "damaged", "missing"])
@pytest.mark.parametrize("slot", [0, 1])
def test_no_byte_changed_and_no_end_cut_off_turns_a_key_into_none(slot, other, tmp_path):
    kept(tmp_path, OLD)
    path, beside = slots(tmp_path)[slot], slots(tmp_path)[1 - slot]
    whole = path.read_bytes()
    if other == "damaged":
        beside.write_bytes(whole[:20])
    elif other == "missing":
        beside.unlink()
    size = len(whole.rstrip(b"\0"))
    for place in (*range(size), size + 1, len(whole) - 1):
        for bit in (0, 7):
            broken = bytearray(whole)
            broken[place] ^= 1 << bit
            path.write_bytes(broken)
            assert found(tmp_path).state is (PRESENT if other == "whole" or place >= size else LOST), place
    for length in (*range(size), size):
        path.write_bytes(whole[:length])
        assert found(tmp_path).state is (PRESENT if other == "whole" or length >= size else LOST), length


@pytest.mark.parametrize("damage", [b"", b"\0" * 4096, b"# rambler state 9 0 00000000\n"])
def test_a_removal_of_which_one_slot_is_damaged_is_no_open_boat(damage, tmp_path):
    """The damaged slot may have held a key that was set after the removal."""
    kept(tmp_path, OLD, REMOVED)
    assert found(tmp_path).state is ABSENT
    slots(tmp_path)[1].write_bytes(damage)
    assert found(tmp_path).state is LOST


def foreign(path):
    os.chown(path, 12345, -1)


def a_directory(path):
    path.unlink()
    path.mkdir()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to another user")
@pytest.mark.parametrize("content", [NEW, REMOVED])
def test_the_files_of_another_user_hold_no_key_and_make_way_for_one(content, tmp_path):
    kept(tmp_path, OLD)
    for path in slots(tmp_path):
        foreign(path)
    finding = found(tmp_path)
    assert finding.state is LOST
    assert finding.problem.startswith("signing.key.0 cannot be read (it belongs to user 12345), signing.key.1")
    kept(tmp_path, content)
    assert found(tmp_path).state is (PRESENT if content else ABSENT)
    assert {path.stat().st_uid for path in slots(tmp_path)} == {0}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lock", "signing.key.0", "signing.key.1"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to another user")
def test_one_file_of_another_user_is_not_believed_beside_one_of_ours(tmp_path):
    kept(tmp_path, OLD, NEW)
    foreign(slots(tmp_path)[1])
    finding = found(tmp_path)
    assert (finding.state, finding.record.key[0], finding.aged) == (PRESENT, 9, True)


def test_the_owner_of_the_files_is_checked_for_any_user(tmp_path, monkeypatch):
    kept(tmp_path, OLD)
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    vault = vault_of(tmp_path)
    finding = find_key(vault.load())
    vault.store.close()
    assert finding.state is LOST
    assert "it belongs to user" in finding.problem


def test_what_is_no_file_is_a_lost_key(tmp_path):
    kept(tmp_path, OLD)
    for path in slots(tmp_path):
        a_directory(path)
    assert found(tmp_path).problem == ", ".join(
        f"{path.name} cannot be read (Is a directory)" for path in slots(tmp_path)
    )


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO])
def test_a_disk_that_does_not_read_is_a_lost_key(number, tmp_path, monkeypatch):
    kept(tmp_path, OLD)

    def fail(*_words):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("os.read", fail)
    assert found(tmp_path).state is LOST
    assert os.strerror(number) in found(tmp_path).problem


def test_files_readable_by_others_are_used_reported_and_made_private_by_the_next_save(tmp_path):
    kept(tmp_path, OLD)
    assert exposed_key_files(tmp_path) == ()
    slots(tmp_path)[1].chmod(0o640)
    assert exposed_key_files(tmp_path) == ("signing.key.1",)
    assert found(tmp_path).state is PRESENT
    kept(tmp_path, NEW)
    assert exposed_key_files(tmp_path) == ()
    assert {stat.S_IMODE(path.stat().st_mode) for path in slots(tmp_path)} == {0o600}


def test_a_save_that_follows_one_into_both_slots_goes_into_both_too(tmp_path):
    """The timestamps are stored soon after a key is set."""
    kept(tmp_path, OLD)
    vault = vault_of(tmp_path)
    vault.save(NEW, both_slots=True)
    assert keep(vault, NEW, both_slots=False)
    vault.store.close()
    assert not any(OLD_SECRET in path.read_bytes() for path in slots(tmp_path))


def test_a_save_that_follows_a_failed_one_into_both_slots_goes_into_both_too(tmp_path, monkeypatch):
    kept(tmp_path, OLD)
    disk = FaultyDisk(tmp_path, monkeypatch)
    vault = vault_of(tmp_path)
    disk.arm(0, lasting=True)
    assert not keep(vault, NEW)
    disk.arm(None)
    vault.save(NEW)  # the failed save is retried with it
    vault.store.close()
    assert not any(OLD_SECRET in path.read_bytes() for path in slots(tmp_path))


def test_a_directory_without_files_of_a_key_never_had_one(tmp_path):
    vault_of(tmp_path).store.close()
    assert vault_of(tmp_path).load() == Stored()
    assert found(tmp_path).state is ABSENT
