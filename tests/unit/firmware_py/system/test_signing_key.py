"""A signing key that was set never counts as never set: after any disk error it is present or reported as lost."""

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
from firmware_py.system.state_directory import SIGNING_FILE, KeyVault, find_exposed_key_files, read_key
from firmware_py.system.store import Store
from support.faulty_disk import CUTS, KINDS, FaultyDisk, sample_calls

OLD, NEW = (to_text(KeyRecord(bytes(32 * [number]), 10**13, {(255, 190, 0): 10**13})) for number in (7, 9))
OLD_SECRET = bytes(32 * [7]).hex().encode()
REMOVED = b""
ABSENT, PRESENT, LOST = KeyState


def open_vault(directory):
    return KeyVault(Store(directory, private=(SIGNING_FILE,)))


def save(vault, content, *, both_slots=True):
    """Save a key; return whether it is on disk."""
    results = []
    vault.save(content, both_slots=both_slots)
    vault.when_stored(results.append)
    while not results:
        assert select.select([vault.store.fileno()], [], [], 10.0)[0]
        vault.store.service()
    return results[0]


def save_in_runs(directory, *contents):
    """Save each content in a run of its own."""
    for content in contents:
        vault = open_vault(directory)
        assert save(vault, content)
        vault.store.close()


def slots(directory):
    return [slot_path(directory, SIGNING_FILE, number) for number in (0, 1)]


def key_of(directory):
    return find_key(read_key(directory))


def has_old_secret(directory):
    return any(OLD_SECRET in path.read_bytes() for path in slots(directory))


def prepare(directory, contents, truncated_slots=(), size=0):
    directory.mkdir()
    save_in_runs(directory, *contents)
    for slot in truncated_slots:
        path = slots(directory)[slot]
        path.write_bytes(path.read_bytes()[:size])


# Name: the arguments of `prepare`, and the state of the key then.
INITIAL_STATES = {
    "never set": (((),), ABSENT),
    "removed": (((OLD, REMOVED),), ABSENT),
    "set": (((OLD,),), PRESENT),
    "set with one slot damaged": (((OLD,), (0,)), PRESENT),
    "lost by empty files": (((OLD,), (0, 1)), LOST),
    "lost by damage": (((OLD,), (0, 1), 40), LOST),
    "removed with one slot damaged": (((REMOVED,), (0,)), LOST),
}
ACTIONS = {"set": (NEW, True), "timestamps": (OLD, False), "remove": (REMOVED, True)}
FAULTS = [(kind, lasting) for kind in KINDS for lasting in (False, True)]


def allowed_states(action, state, *, stored):
    """Return the states that the next start may find."""
    if action == "remove":
        return {ABSENT} if stored else {state, ABSENT, LOST}
    if stored:
        return {PRESENT}
    return {PRESENT, LOST} if state is not ABSENT else {ABSENT, PRESENT, LOST}


def check_action(action, prepared, state, folder, monkeypatch, at, kind, *, lasting):
    """Do an action on a failing disk; return the number of its calls."""
    content, both_slots = ACTIONS[action]
    shutil.copytree(prepared, folder / "state")
    with monkeypatch.context() as patches:
        patches.setattr("firmware_py.system.store.RETRY_S", 1000.0)
        disk = FaultyDisk(folder / "state", patches)
        for path in disk.directory.iterdir():
            disk.names[path.name], disk.durable[path.name] = None, path.read_bytes()
        vault = open_vault(disk.directory)
        disk.arm(at, kind, lasting=lasting)
        stored = save(vault, content, both_slots=both_slots)
        failed_calls, calls = list(disk.failed), disk.count
        with disk.lock:
            shutil.copytree(disk.directory, folder / "killed")
            for pattern in CUTS:
                disk.cut(folder / pattern, pattern)
        disk.arm(None)
        vault.store.close()
    for image in [folder / name for name in ("killed", *CUTS)]:
        states = allowed_states(action, state, stored=stored)
        assert key_of(image).state in states, (image.name, failed_calls, stored)
        assert action == "timestamps" or not (stored and has_old_secret(image))
    # When the disk works again, the action is done and the old key is overwritten.
    assert key_of(folder / "state").state is (ABSENT if action == "remove" else PRESENT)
    assert action == "timestamps" or not has_old_secret(folder / "state")
    return calls


# Timestamps need a key, and removing an absent key is harmless.
CASES = [
    (action, name)
    for action in ACTIONS
    for name, (_, state) in INITIAL_STATES.items()
    if state in {"set": KeyState, "timestamps": (PRESENT,), "remove": (PRESENT, LOST)}[action]
]


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.proof)], ids=["sampled", "every"])
@pytest.mark.parametrize(("action", "initial"), CASES)
def test_after_a_failed_call_a_key_that_was_set_is_present_or_lost(action, initial, every, tmp_path, monkeypatch):
    arguments, state = INITIAL_STATES[initial]
    prepared = tmp_path / "prepared"
    prepare(prepared, *arguments)
    assert key_of(prepared).state is state

    def count_calls(at, kind, *, lasting):
        folder = tmp_path / "case"
        folder.mkdir()
        calls = check_action(action, prepared, state, folder, monkeypatch, at, kind, lasting=lasting)
        shutil.rmtree(folder)
        return calls

    cases, calls = 0, count_calls(None, "refused", lasting=False)
    for kind, lasting in FAULTS:
        for at in itertools.count() if every else sample_calls(calls, 2, f"{action} {initial} {kind} {lasting}"):
            if count_calls(at, kind, lasting=lasting) <= at:
                break
            cases += 1
    assert cases >= 2 * len(FAULTS)


@pytest.mark.parametrize("other", ["whole", "damaged", "missing"])
@pytest.mark.parametrize("slot", [0, 1])
def test_a_changed_byte_or_a_truncation_never_makes_a_key_absent(slot, other, tmp_path):
    save_in_runs(tmp_path, OLD)
    path, other_path = slots(tmp_path)[slot], slots(tmp_path)[1 - slot]
    content = path.read_bytes()
    if other == "damaged":
        other_path.write_bytes(content[:20])
    elif other == "missing":
        other_path.unlink()
    size = len(content.rstrip(b"\0"))
    for index in (*range(size), size + 1, len(content) - 1):
        for bit in (0, 7):
            damaged = bytearray(content)
            damaged[index] ^= 1 << bit
            path.write_bytes(damaged)
            assert key_of(tmp_path).state is (PRESENT if other == "whole" or index >= size else LOST), index
    for length in (*range(size), size):
        path.write_bytes(content[:length])
        assert key_of(tmp_path).state is (PRESENT if other == "whole" or length >= size else LOST), length


@pytest.mark.parametrize("damage", [b"", b"\0" * 4096, b"# rambler state 9 0 00000000\n"])
def test_after_a_removal_a_damaged_slot_makes_the_key_lost(damage, tmp_path):
    """The slot may have contained a key that was set after the removal."""
    save_in_runs(tmp_path, OLD, REMOVED)
    assert key_of(tmp_path).state is ABSENT
    slots(tmp_path)[1].write_bytes(damage)
    assert key_of(tmp_path).state is LOST


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of a file")


@needs_root
@pytest.mark.parametrize("content", [NEW, REMOVED])
def test_files_of_another_user_contain_no_key_and_are_replaced(content, tmp_path):
    save_in_runs(tmp_path, OLD)
    for path in slots(tmp_path):
        os.chown(path, 12345, -1)
    finding = key_of(tmp_path)
    assert finding.state is LOST
    assert finding.problem.startswith("signing.key.0 cannot be read (it belongs to user 12345), signing.key.1")
    save_in_runs(tmp_path, content)
    assert key_of(tmp_path).state is (PRESENT if content else ABSENT)
    assert {path.stat().st_uid for path in slots(tmp_path)} == {0}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lock", "signing.key.0", "signing.key.1"]


@needs_root
def test_a_newer_slot_of_another_user_is_ignored(tmp_path):
    save_in_runs(tmp_path, OLD, NEW)
    os.chown(slots(tmp_path)[1], 12345, -1)
    finding = key_of(tmp_path)
    assert (finding.state, finding.record.key[0], finding.may_be_outdated) == (PRESENT, 9, True)


def test_a_vault_does_not_read_files_of_other_users(tmp_path, monkeypatch):
    save_in_runs(tmp_path, OLD)
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    vault = open_vault(tmp_path)
    finding = find_key(vault.load())
    vault.store.close()
    assert finding.state is LOST
    assert "it belongs to user" in finding.problem


def test_directories_in_place_of_the_slots_are_a_lost_key(tmp_path):
    for path in slots(tmp_path):
        path.mkdir()
    problems = [f"{path.name} cannot be read (Is a directory)" for path in slots(tmp_path)]
    assert key_of(tmp_path).problem == ", ".join(problems)


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO])
def test_a_read_error_is_a_lost_key(number, tmp_path, monkeypatch):
    def fail(*_arguments):
        raise OSError(number, os.strerror(number))

    save_in_runs(tmp_path, OLD)
    monkeypatch.setattr("os.read", fail)
    assert key_of(tmp_path).state is LOST
    assert os.strerror(number) in key_of(tmp_path).problem


def test_files_readable_by_others_are_reported_and_made_private_by_the_next_save(tmp_path):
    save_in_runs(tmp_path, OLD)
    assert find_exposed_key_files(tmp_path) == ()
    slots(tmp_path)[1].chmod(0o640)
    assert find_exposed_key_files(tmp_path) == ("signing.key.1",)
    assert key_of(tmp_path).state is PRESENT
    save_in_runs(tmp_path, NEW)
    assert find_exposed_key_files(tmp_path) == ()
    assert {stat.S_IMODE(path.stat().st_mode) for path in slots(tmp_path)} == {0o600}


@pytest.mark.parametrize("fails", [False, True])
def test_timestamps_saved_soon_after_a_key_are_written_to_both_slots(fails, tmp_path, monkeypatch):
    save_in_runs(tmp_path, OLD)
    disk = FaultyDisk(tmp_path, monkeypatch)
    vault = open_vault(tmp_path)
    if fails:
        disk.arm(0, lasting=True)
        assert not save(vault, NEW)
        disk.arm(None)
    else:
        vault.save(NEW, both_slots=True)
    assert save(vault, NEW, both_slots=False)
    vault.store.close()
    assert not has_old_secret(tmp_path)


def test_a_directory_without_key_files_never_had_a_key(tmp_path):
    open_vault(tmp_path).store.close()
    assert open_vault(tmp_path).load() == Stored()
    assert key_of(tmp_path).state is ABSENT
