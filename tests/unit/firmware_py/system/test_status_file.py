"""The status file: where it goes, who may read it, what it is worth."""

import json
import os
import stat
from pathlib import Path

import pytest

from firmware_py.install.environment import Environment, work_directory
from firmware_py.system.status_file import STALE_S, Freshness, StatusFile, file_name, find, find_all, is_memory

NOW_S = 1000.0


@pytest.fixture
def memory(tmp_path, monkeypatch):
    """A directory that counts as memory."""
    monkeypatch.setattr("firmware_py.system.status_file.is_memory", lambda directory: directory.name == "memory")
    (tmp_path / "memory").mkdir()
    return tmp_path / "memory"


@pytest.fixture
def state(tmp_path):
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


def content(state, **more):
    content = {"written_machine_s": NOW_S, "pid": os.getpid(), "state_directory": str(state), "mode": "HOLD", **more}
    return json.dumps(content).encode()


def test_memory_is_distinguished_from_a_disk():
    assert is_memory(Path("/dev/shm"))
    assert not is_memory(Path("/proc"))


def test_what_was_written_last_is_found_whole_by_any_path_that_leads_there(memory, state, tmp_path):
    (tmp_path / "link").symlink_to(state)
    file = StatusFile(state, (memory,))
    for mode in ("HOLD", "AUTO"):
        file.write(content(state, mode=mode))
    found = find(tmp_path / "link", NOW_S + 1.0, (memory,))
    assert (found.freshness, found.content["mode"], found.age_s) == (Freshness.RUNNING, "AUTO", 1.0)
    assert [path.name for path in memory.iterdir()] == [file_name(state)]
    assert stat.S_IMODE((memory / file_name(state)).stat().st_mode) & ~0o640 == 0
    assert list(find_all(NOW_S, (memory,))) == [file_name(state)]


def test_what_an_update_tries_is_no_boat(memory, state, tmp_path):
    """`rambler status` would say that there are several, and name the copy, in the midst of each update."""
    tried = work_directory(Environment(tmp_path / "rambler")) / "state"
    tried.mkdir()
    for directory in (state, tried):
        StatusFile(directory, (memory,)).write(content(directory))
    assert list(find_all(NOW_S, (memory,))) == [file_name(state)]
    assert find(tried, NOW_S, (memory,)).freshness is Freshness.RUNNING


def test_what_finds_room_for_a_part_only_is_not_put_in_place(memory, state, monkeypatch):
    file = StatusFile(state, (memory,))
    file.write(content(state))
    rooms, write = [10], os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[: rooms.pop() if rooms else 0]))
    with pytest.raises(OSError, match="No space left"):
        file.write(content(state, mode="AUTO"))
    assert find(state, NOW_S, (memory,)).content["mode"] == "HOLD"
    assert "is full" in find(state, NOW_S + 60.0, (memory,)).reason
    assert [path.name for path in memory.iterdir()] == [file_name(state)]


def test_nothing_is_written_where_it_would_wear_a_disk(memory, state, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    with pytest.raises(OSError, match="in memory"):
        StatusFile(state, (disk, tmp_path / "none")).write(b"{}")
    assert not any(disk.iterdir())
    StatusFile(state, (disk, memory)).write(b"{}")
    assert len(list(memory.iterdir())) == 1


def test_a_directory_that_was_away_is_taken_again(memory, state):
    file = StatusFile(state, (memory,))
    file.write(content(state))
    (memory / file_name(state)).unlink()
    file.write(content(state))
    assert find(state, NOW_S, (memory,)).freshness is Freshness.RUNNING
    file.remove()
    file.remove()
    assert find(state, NOW_S, (memory,)).freshness is Freshness.ABSENT


def test_a_symbolic_link_is_not_followed(memory, state, tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    name = file_name(state)
    (memory / name).symlink_to(victim)
    (memory / name).with_suffix(".new").symlink_to(victim)
    assert find(state, NOW_S, (memory,)).freshness is Freshness.ABSENT
    StatusFile(state, (memory,)).write(content(state))
    assert victim.read_text() == "mine"
    assert find(state, NOW_S, (memory,)).freshness is Freshness.RUNNING


@pytest.mark.parametrize("age_s", [STALE_S + 0.1, -STALE_S - 0.1, 1e9])
def test_an_old_status_is_stale_and_still_shown(memory, state, age_s):
    StatusFile(state, (memory,)).write(content(state))
    found = find(state, NOW_S + age_s, (memory,))
    assert (found.freshness, found.content["mode"]) == (Freshness.STALE, "HOLD")
    assert "hangs or is stopped" in found.reason


@pytest.mark.parametrize("pid", [2**22 + 5, 2**40])
def test_a_recent_status_of_an_ended_process_is_stale(memory, state, pid):
    StatusFile(state, (memory,)).write(content(state, pid=pid))
    found = find(state, NOW_S, (memory,))
    assert found.freshness is Freshness.STALE
    assert "has ended" in found.reason


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
    found = find(state, NOW_S, (memory,))
    assert found.freshness is Freshness.ABSENT
    assert file_name(state) in found.reason


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_owner_of_a_status_is_reported(memory, state):
    StatusFile(state, (memory,)).write(content(state))
    os.chown(state, 4242, 4242)
    os.chown(memory / file_name(state), 4242, 4242)
    assert find(state, NOW_S, (memory,)).content["user"] == "4242"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_newer_word_of_another_user_is_not_believed(memory, state, tmp_path):
    anybody = tmp_path / "anybody"
    anybody.mkdir(mode=0o1777)
    anybody.chmod(0o1777)
    (memory / file_name(state)).write_bytes(content(state, armed=True))
    (anybody / file_name(state)).write_bytes(content(state, armed=False, written_machine_s=NOW_S + 2.0))
    os.chown(anybody / file_name(state), 4242, 4242)
    places = (memory, anybody)
    assert find(state, NOW_S + 3.0, places).content["armed"]
    assert find_all(NOW_S + 3.0, places)[file_name(state)].content["armed"]
    found = find(state, NOW_S + 3.0, (anybody,))
    assert (found.freshness, found.content, found.is_refused) == (Freshness.ABSENT, {}, True)
    assert "belongs to user 4242, who is not trusted here" in found.reason
    # Nor one that names a state directory of the forger's, by the name of this one.
    forged = tmp_path / "forged"
    forged.mkdir()
    os.chown(forged, 4242, 4242)
    (anybody / file_name(state)).write_bytes(content(forged, armed=False))
    os.chown(anybody / file_name(state), 4242, 4242)
    assert find_all(NOW_S, (anybody,)) == {}


@pytest.mark.parametrize("mode", [0o660, 0o602])
def test_a_file_that_others_may_write_is_not_believed(memory, state, mode):
    (memory / file_name(state)).write_bytes(content(state))
    (memory / file_name(state)).chmod(mode)
    found = find(state, NOW_S, (memory,))
    assert found.is_refused
    assert "is writable by other users" in found.reason


def test_of_two_places_the_newest_word_counts(memory, state, tmp_path):
    (tmp_path / "other").mkdir()
    StatusFile(state, (memory,)).write(content(state, mode="HOLD"))
    (tmp_path / "other" / file_name(state)).write_bytes(content(state, mode="AUTO", written_machine_s=NOW_S + 2.0))
    assert find(state, NOW_S + 3.0, (memory, tmp_path / "other")).content["mode"] == "AUTO"
