"""`rambler plan` from the outside."""

import errno
import json
import os

import pytest

from firmware_py.__main__ import main
from firmware_py.plans.items import TABLE
from firmware_py.system.store import Store

WAYPOINTS = (
    "QGC WPL 110\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n"
    "1\t0\t3\t16\t0\t5.5\t0\tnan\t36.1234567\t121.1\t0\t1\n"
    "2\t0\t2\t177\t1\t-1\t0\t0\t0\t0\t0\t1\n"
)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.waypoints"
    path.write_text(WAYPOINTS)
    return path


@pytest.fixture
def state(tmp_path):
    directory = tmp_path / "state"
    directory.mkdir()
    return directory


def said(capsys, *words, code=0):
    assert main(["plan", *map(str, words)]) == code
    captured = capsys.readouterr()
    return captured.err if code else captured.out


def shown(capsys, state):
    return json.loads(said(capsys, "show", "--json", "--state", state))


def test_a_plan_goes_into_a_state_and_out_again(capsys, tmp_path, file, state):
    assert said(capsys, "check", file) == f"{file}: mission: 2 items, all valid\n"
    assert said(capsys, "load", file, "--state", state) == f"{state}: mission: 2 items\n"
    first, jump = shown(capsys, state)["mission"]
    assert (first["latitude_deg"], first["params"]) == (36.1234567, [0.0, 5.5, 0.0, None])
    assert (jump["name"], jump["params"]) == ("DO_JUMP", [0.0, -1.0, 0.0, 0.0])
    assert "NAV_WAYPOINT" in said(capsys, "show", "--state", state)
    before = shown(capsys, state)
    for name in ("b.plan", "b.waypoints"):
        said(capsys, "save", tmp_path / name, "--state", state)
        assert json.loads(said(capsys, "check", "--json", tmp_path / name))["mission"] == before["mission"]
        said(capsys, "load", tmp_path / name, "--state", state)
        assert shown(capsys, state) == before


def test_a_plan_that_is_refused_changes_nothing(capsys, file, state):
    said(capsys, "load", file, "--state", state)
    before = shown(capsys, state)
    file.write_text(WAYPOINTS.replace("\t177\t1\t", "\t177\t9\t"))
    error = said(capsys, "load", file, "--state", state, code=2)
    text = "item 2: DO_JUMP: the target item does not exist; correct it (home is item 0)"
    assert error == f"rambler plan load: {file}: mission: {text}\n"
    assert shown(capsys, state) == before


def test_a_state_in_use_is_left_to_the_ground_stations_but_can_be_shown(capsys, file, state):
    store = Store(state)
    try:
        error = said(capsys, "load", file, "--state", state, code=2)
        assert "in use" in error
        assert "ground station" in error
        assert shown(capsys, state) == {"mission": [], "fence": [], "rally": []}
    finally:
        store.close()


def test_a_disk_that_fails_is_told(capsys, file, state, monkeypatch):
    def no_room(*_words):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", no_room)
    error = said(capsys, "load", file, "--state", state, code=2)
    assert "cannot be stored" in error
    assert error.count("\n") == 1


def test_the_table_of_items_is_complete(capsys):
    table = said(capsys, "items")
    assert all(f"| {row.name} | {int(row.command)} |" in table for row in TABLE)


def test_a_plan_that_was_lost_is_told_by_name(capsys, file, state):
    for _ in range(2):
        said(capsys, "load", file, "--state", state)
    (state / "mission.plan.1").write_bytes(bytes(4096))
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: the other slot is used" in capsys.readouterr().err
    (state / "mission.plan.0").unlink()
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: no plan remains" in capsys.readouterr().err


def test_states_that_are_none(capsys, file, tmp_path, state):
    told = said(capsys, "show", "--state", tmp_path / "none", code=2)
    assert told.endswith(f"{tmp_path / 'none'} does not exist; give that of `rambler run --state`, or create it: "
                         f"mkdir -p {tmp_path / 'none'}\n")  # fmt: skip
    assert "is a file; give that of" in said(capsys, "load", file, "--state", file, code=2)
    said(capsys, "load", file, "--state", tmp_path / "a" / "new", code=0)
    assert len(shown(capsys, tmp_path / "a" / "new")["mission"]) == 2
    store = Store(state)
    store.save("mission.plan", b"nonsense")
    store.close()
    assert "load the plan again" in said(capsys, "show", "--state", state, code=2)
    said(capsys, "load", file, "--state", state)
    assert "Is a directory" in said(capsys, "save", tmp_path, "--state", state, code=2)
    assert "see rambler plan" in said(capsys, "show", code=2)


def test_a_file_that_cannot_be_read_is_named(capsys, tmp_path):
    assert "No such file" in said(capsys, "check", tmp_path / "none", code=2)
    assert "Is a directory" in said(capsys, "check", tmp_path, code=2)
    huge = tmp_path / "huge"
    huge.write_bytes(b"1 2\n" * (3 << 20))
    assert "larger than" in said(capsys, "check", huge, code=2)


OUTSIDE = {
    "fileType": "Plan",
    "mission": {
        "items": [
            {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, latitude_deg, 121.0, 0]}
            for latitude_deg in (36.001, 36.01, 36.02)
        ]
    },
    "geoFence": {
        "polygons": [
            {"inclusion": True, "polygon": [[36.003, 120.99], [36.003, 121.01], [35.99, 121.01], [35.99, 120.99]]}
        ]
    },
}
WARNED = "warning: Mission item 2 is 778 m outside the fence\n"


def test_a_mission_outside_the_fence_is_told(capsys, tmp_path, state):
    both, mission = tmp_path / "both.plan", tmp_path / "mission.plan"
    both.write_text(json.dumps(OUTSIDE))
    mission.write_text(json.dumps({"fileType": "Plan", "mission": OUTSIDE["mission"]}))
    assert main(["plan", "check", str(both)]) == 0
    out, err = capsys.readouterr()
    assert f"{both}: mission: 3 items, 2 outside the fence\n{both}: fence: 4 items, all valid\n" == out
    assert err.startswith(f"{both}: {WARNED}{both}: warning: Mission item 3 is 18")
    assert main(["plan", "check", str(mission)]) == 0
    assert capsys.readouterr() == (f"{mission}: mission: 3 items, all valid\n", "")
    for file in (both, mission):  # with its own fence, and with the one that is in force
        assert main(["plan", "load", str(file), "--state", str(state)]) == 0
        assert capsys.readouterr().err.startswith(f"{state}: {WARNED}")


@pytest.mark.parametrize("text", ['{"version": 1, "polygon": [[1, 2]]}', '{"version": 2, "polygon": []}', "{}"])
def test_a_fence_that_is_not_understood_leaves_the_one_in_force(capsys, tmp_path, state, text):
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(OUTSIDE))
    main(["plan", "load", str(path), "--state", str(state)])
    capsys.readouterr()
    before = shown(capsys, state)
    path.write_text(f'{{"fileType": "Plan", "mission": {{"items": []}}, "geoFence": {text}}}')
    assert "geoFence: " in said(capsys, "load", path, "--state", state, code=2)
    assert shown(capsys, state) == before
    path.write_text('{"fileType": "Plan", "geoFence": {"polygons": [], "circles": []}}')
    assert said(capsys, "load", path, "--state", state) == f"{state}: fence: 0 items, 4 removed\n"
