"""The status file: its directory, its permissions, and its validity for readers."""

import json
import os
import pwd
import stat
from pathlib import Path

import pytest

from firmware_py.install.environment import Environment, create_work_directory
from firmware_py.system.status_file import (
    Freshness,
    StatusFile,
    file_name,
    find_all_statuses,
    find_status,
    is_in_memory,
)

MAX_AGE_S = 5.0

NOW_S = 1000.0
OTHER_UID = 4242
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of a file")


@pytest.fixture
def memory(tmp_path, monkeypatch):
    """Return a directory that counts as in memory."""
    monkeypatch.setattr("firmware_py.system.status_file.is_in_memory", lambda directory: directory.name == "memory")
    (tmp_path / "memory").mkdir()
    return tmp_path / "memory"


@pytest.fixture
def state(tmp_path):
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


def content(state, **changes):
    values = {"written_machine_s": NOW_S, "pid": os.getpid(), "state_directory": str(state), "mode": "HOLD", **changes}
    return json.dumps(values).encode()


def give_away(*paths):
    for path in paths:
        os.chown(path, OTHER_UID, OTHER_UID)


def test_name_of_the_file_is_the_same_for_all_versions():
    assert file_name(Path("/")) == "rambler-status-8a5edab282632443.json"  # SHA-256 of the path


@pytest.mark.parametrize(("size", "freshness"), [(1 << 18, Freshness.RUNNING), ((1 << 18) + 1, Freshness.ABSENT)])
def test_status_is_read_up_to_its_size_limit(memory, state, size, freshness):
    StatusFile(state, (memory,)).write(content(state).ljust(size))
    assert find_status(state, NOW_S, (memory,)).freshness is freshness


def test_memory_is_distinguished_from_other_file_systems():
    assert is_in_memory(Path("/dev/shm"))
    assert not is_in_memory(Path("/proc"))


@pytest.mark.parametrize(
    ("number", "end", "expected"),
    [
        ("{}", "tmpfs none rw", True),
        ("{}", "ramfs none rw", True),
        ("{}", "ext4 tmpfs rw", False),
        ("999:1{}", "tmpfs none rw", False),
    ],
)
def test_memory_is_recognised_by_the_type_of_the_mount(tmp_path, monkeypatch, number, end, expected):
    device = tmp_path.stat().st_dev
    line = f"36 35 {number.format(f'{os.major(device)}:{os.minor(device)}')} / /mnt rw,noatime shared:1 - {end}\n"
    monkeypatch.setattr(Path, "read_text", lambda *_arguments, **_options: line)
    assert is_in_memory(tmp_path) is expected


def test_the_last_status_is_found_by_any_path_of_the_state_directory(memory, state, tmp_path):
    (tmp_path / "link").symlink_to(state)
    file = StatusFile(state, (memory,))
    for mode in ("HOLD", "AUTO"):
        file.write(content(state, mode=mode))
    status = find_status(tmp_path / "link", NOW_S + 1.0, (memory,))
    assert (status.freshness, status.content["mode"], status.age_s) == (Freshness.RUNNING, "AUTO", 1.0)
    assert (status.content["user"], status.reason) == (pwd.getpwuid(os.geteuid()).pw_name, "")
    assert [path.name for path in memory.iterdir()] == [file_name(state)]
    assert stat.S_IMODE((memory / file_name(state)).stat().st_mode) & ~0o640 == 0
    assert list(find_all_statuses(NOW_S, (memory,))) == [file_name(state)]


def test_the_test_run_of_an_update_is_not_listed(memory, state, tmp_path):
    trial = create_work_directory(Environment(tmp_path / "rambler")) / "state"
    trial.mkdir()
    for directory in (state, trial):
        StatusFile(directory, (memory,)).write(content(directory))
    assert list(find_all_statuses(NOW_S, (memory,))) == [file_name(state)]
    assert find_status(trial, NOW_S, (memory,)).freshness is Freshness.RUNNING


def test_a_partially_written_status_does_not_replace_the_last_one(memory, state, monkeypatch):
    file = StatusFile(state, (memory,))
    file.write(content(state))
    sizes, write = [10], os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[: sizes.pop() if sizes else 0]))
    with pytest.raises(OSError, match="No space left"):
        file.write(content(state, mode="AUTO"))
    assert find_status(state, NOW_S, (memory,)).content["mode"] == "HOLD"
    assert "is full" in find_status(state, NOW_S + 60.0, (memory,)).reason
    assert [path.name for path in memory.iterdir()] == [file_name(state)]


def test_a_directory_on_a_disk_is_not_used(memory, state, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    with pytest.raises(OSError, match="in memory"):
        StatusFile(state, (disk, tmp_path / "none")).write(b"{}")
    assert not any(disk.iterdir())
    StatusFile(state, (disk, memory)).write(b"{}")
    assert len(list(memory.iterdir())) == 1


def test_a_removed_file_is_written_again_and_absent_after_the_end(memory, state):
    file = StatusFile(state, (memory,))
    file.write(content(state))
    (memory / file_name(state)).unlink()
    file.write(content(state))
    assert find_status(state, NOW_S, (memory,)).freshness is Freshness.RUNNING
    file.remove()
    file.remove()
    status = find_status(state, NOW_S, (memory,))
    assert (status.freshness, status.is_refused) == (Freshness.ABSENT, False)


def test_a_symbolic_link_is_not_followed(memory, state, tmp_path):
    victim = tmp_path / "victim"
    victim.write_bytes(content(state))
    path = memory / file_name(state)
    for link in (path, path.with_suffix(".new")):
        link.symlink_to(victim)
    assert find_status(state, NOW_S, (memory,)).freshness is Freshness.ABSENT
    StatusFile(state, (memory,)).write(content(state))
    assert victim.read_bytes() == content(state)
    assert find_status(state, NOW_S, (memory,)).freshness is Freshness.RUNNING


@pytest.mark.parametrize(
    ("age_s", "changes", "reason"),
    [
        *((age_s, {}, "") for age_s in (MAX_AGE_S, -MAX_AGE_S)),
        *((age_s, {}, "hangs or is stopped") for age_s in (MAX_AGE_S + 0.1, -MAX_AGE_S - 0.1, 1e9)),
        *((0.0, {"pid": pid}, "has ended") for pid in (2**22 + 5, 2**40)),
    ],
)
def test_a_status_that_is_old_or_of_an_ended_process_is_stale(memory, state, age_s, changes, reason):
    StatusFile(state, (memory,)).write(content(state, **changes))
    status = find_status(state, NOW_S + age_s, (memory,))
    assert (status.freshness, status.content["mode"]) == (Freshness.STALE if reason else Freshness.RUNNING, "HOLD")
    assert reason in status.reason
    assert bool(reason) == bool(status.reason)


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"[]", b"null", b"\xff", b'{"pid": 1}', b'{"pid": "x", "written_machine_s": 0, "state_directory": "/"}',
     b'{"pid": 1, "written_machine_s": NaN, "state_directory": 5}', b"[" * 100000,
     b'{"pid": 1e400, "written_machine_s": 0, "state_directory": "/"}',
     b'{"pid": 1, "written_machine_s": 1' + b"0" * 400 + b', "state_directory": "/"}',
     b'{"pid": 1, "written_machine_s": 0, "state_directory": "/", "mode": "HOLD", "x": 1e400}',
     b'{"pid": 1, "written_machine_s": 0, "state_directory": "/", "x": ' + b"[" * 900 + b"]" * 900 + b"}"],
)  # fmt: skip
def test_a_file_that_is_not_a_status_is_reported(memory, state, data):
    (memory / file_name(state)).write_bytes(data)
    status = find_status(state, NOW_S, (memory,))
    assert status.freshness is Freshness.ABSENT
    assert file_name(state) in status.reason


@pytest.mark.parametrize(
    "error", [PermissionError(1, "Operation not permitted"), ProcessLookupError(3, "No such process")]
)
def test_a_process_of_another_user_is_running(memory, state, monkeypatch, error):
    def fail(*_arguments):
        raise error

    StatusFile(state, (memory,)).write(content(state))
    monkeypatch.setattr(os, "kill", fail)
    freshness = Freshness.RUNNING if isinstance(error, PermissionError) else Freshness.STALE
    assert find_status(state, NOW_S, (memory,)).freshness is freshness


def test_a_status_that_this_user_may_not_read_has_a_remedy(memory, state, monkeypatch):
    def fail(*_arguments, **_options):
        raise PermissionError(13, "Permission denied")

    StatusFile(state, (memory,)).write(content(state))
    monkeypatch.setattr("firmware_py.system.status_file.read_regular", fail)
    status = find_status(state, NOW_S, (memory,))
    assert (status.freshness, status.is_refused) == (Freshness.ABSENT, False)
    assert status.reason.endswith(": Permission denied; use an account of its group")


@needs_root
def test_the_owner_of_a_status_is_reported(memory, state):
    StatusFile(state, (memory,)).write(content(state))
    give_away(state, memory / file_name(state))
    assert find_status(state, NOW_S, (memory,)).content["user"] == str(OTHER_UID)


@needs_root
def test_a_status_of_an_untrusted_user_is_refused(memory, state, tmp_path):
    public = tmp_path / "public"
    public.mkdir()
    public.chmod(0o1777)
    forged = public / file_name(state)
    (memory / file_name(state)).write_bytes(content(state, armed=True))
    forged.write_bytes(content(state, armed=False, written_machine_s=NOW_S + 2.0))
    give_away(forged)
    directories = (memory, public)
    assert find_status(state, NOW_S + 3.0, directories).content["armed"]
    assert find_all_statuses(NOW_S + 3.0, directories)[file_name(state)].content["armed"]
    status = find_status(state, NOW_S + 3.0, (public,))
    assert (status.freshness, status.content, status.is_refused) == (Freshness.ABSENT, {}, True)
    assert f"belongs to user {OTHER_UID}, who is not trusted here" in status.reason
    # The file names a state directory of the untrusted user, but has the name for this one.
    forged_state = tmp_path / "forged"
    forged_state.mkdir()
    forged.write_bytes(content(forged_state, armed=False))
    give_away(forged_state, forged)
    assert find_all_statuses(NOW_S, (public,)) == {}


@needs_root
def test_status_of_root_is_trusted_in_any_directory(state, tmp_path):
    tmp_path.chmod(0o1777)
    (tmp_path / file_name(state)).write_bytes(content(state))
    give_away(state)
    assert find_status(state, NOW_S, (tmp_path,)).freshness is Freshness.RUNNING


@needs_root
@pytest.mark.parametrize(("mode", "is_refused"), [(0o755, False), (0o775, True), (0o1777, True)])
def test_the_owner_of_a_directory_is_trusted_if_others_cannot_write_to_it(state, tmp_path, mode, is_refused):
    directory = tmp_path / "directory"
    directory.mkdir()
    directory.chmod(mode)
    (directory / file_name(state)).write_bytes(content(state))
    (directory / file_name(state)).chmod(0o640)
    give_away(directory, directory / file_name(state))
    assert find_status(state, NOW_S, (directory,)).is_refused is is_refused


@pytest.mark.parametrize("mode", [0o660, 0o602])
def test_a_file_that_others_may_write_is_refused(memory, state, mode):
    (memory / file_name(state)).write_bytes(content(state))
    (memory / file_name(state)).chmod(mode)
    status = find_status(state, NOW_S, (memory,))
    assert status.is_refused
    assert "is writable by other users" in status.reason


def test_of_two_directories_the_newest_status_is_returned(memory, state, tmp_path):
    (tmp_path / "other").mkdir()
    StatusFile(state, (memory,)).write(content(state, mode="HOLD"))
    (tmp_path / "other" / file_name(state)).write_bytes(content(state, mode="AUTO", written_machine_s=NOW_S + 2.0))
    assert find_status(state, NOW_S + 3.0, (memory, tmp_path / "other")).content["mode"] == "AUTO"
