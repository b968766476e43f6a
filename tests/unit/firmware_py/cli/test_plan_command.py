"""`rambler plan`: check, load, show and save."""

import errno
import json
import os
import re

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
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


@pytest.fixture
def plan(capsys):
    """Run a subcommand; return its output, or for code 2 its error."""

    def run(*words, code=0):
        assert main(["plan", *map(str, words)]) == code
        captured = capsys.readouterr()
        return captured.err if code else captured.out

    return run


def stored_plans(plan, state):
    return json.loads(plan("show", "--json", "--state", state))


def test_plan_is_loaded_shown_and_saved(plan, tmp_path, file, state):
    assert plan("check", file) == f"{file}: mission: 2 items, all valid\n"
    assert plan("load", file, "--state", state) == f"{state}: mission: 2 items\n"
    plans = stored_plans(plan, state)
    waypoint, jump = plans["mission"]
    assert (waypoint["latitude_deg"], waypoint["params"]) == (36.1234567, [0.0, 5.5, 0.0, None])
    assert (jump["name"], jump["params"]) == ("DO_JUMP", [0.0, -1.0, 0.0, 0.0])
    first, *lines = plan("show", "--state", state).splitlines()
    assert re.fullmatch("mission: 2 items, id [0-9a-f]{8}", first)
    assert lines == [
        "    1  NAV_WAYPOINT  0 5.5 0 nan  36.1234567 121.1000000",
        "    2  DO_JUMP  1 -1 0 0",
        "fence: 0 items",
        "rally: 0 items",
    ]
    for name in ("b.plan", "b.waypoints"):
        plan("save", tmp_path / name, "--state", state)
        assert json.loads(plan("check", "--json", tmp_path / name))["mission"] == plans["mission"]
        plan("load", tmp_path / name, "--state", state)
        assert stored_plans(plan, state) == plans


def test_refused_plan_changes_nothing(plan, file, state):
    plan("load", file, "--state", state)
    plans = stored_plans(plan, state)
    file.write_text(WAYPOINTS.replace("\t177\t1\t", "\t177\t9\t"))
    text = "item 2: DO_JUMP: the target item does not exist; correct it (home is item 0)"
    assert plan("load", file, "--state", state, code=2) == f"rambler plan load: {file}: mission: {text}\n"
    assert stored_plans(plan, state) == plans


def test_state_in_use_is_shown_but_not_changed(plan, file, state):
    store = Store(state)
    try:
        error = plan("load", file, "--state", state, code=2)
        assert "in use" in error
        assert "ground station" in error
        assert stored_plans(plan, state) == {"mission": [], "fence": [], "rally": []}
    finally:
        store.close()


def test_only_the_owner_loads_a_plan(plan, file, state, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    assert "run this as that user" in plan("load", file, "--state", state, code=2)


def test_full_disk_is_a_one_line_error(plan, file, state, monkeypatch):
    def raise_full(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", raise_full)
    error = plan("load", file, "--state", state, code=2)
    assert ("cannot be stored" in error, error.count("\n")) == (True, 1)


def test_table_of_items_is_complete(plan):
    table = plan("items")
    assert all(f"| {row.name} | {int(row.command)} |" in table for row in TABLE)


def test_damaged_slots_are_reported(plan, file, state, capsys):
    for _ in range(2):
        plan("load", file, "--state", state)
    (state / "mission.plan.1").write_bytes(bytes(4096))
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: the other slot is used" in capsys.readouterr().err
    (state / "mission.plan.0").unlink()
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: no plan remains" in capsys.readouterr().err


def test_unusable_state_directory_is_refused(plan, file, tmp_path, state):
    none = tmp_path / "none"
    remedy = f"give that of `rambler run --state`, or create it: mkdir -p {none}\n"
    assert plan("show", "--state", none, code=2).endswith(f"{none} does not exist; {remedy}")
    assert "is a file; give that of" in plan("load", file, "--state", file, code=2)
    plan("load", file, "--state", tmp_path / "a" / "new")
    assert len(stored_plans(plan, tmp_path / "a" / "new")["mission"]) == 2
    store = Store(state)
    store.save("mission.plan", b"nonsense")
    store.close()
    assert "load the plan again" in plan("show", "--state", state, code=2)
    plan("load", file, "--state", state)
    assert "Is a directory" in plan("save", tmp_path, "--state", state, code=2)
    assert "see rambler plan" in plan("show", code=2)


def test_unreadable_plan_file_is_refused(plan, tmp_path):
    (tmp_path / "huge").write_bytes(b"1 2\n" * (3 << 20))
    for path, reason in (
        (tmp_path / "none", "No such file"),
        (tmp_path, "Is a directory"),
        (tmp_path / "huge", "large"),
    ):
        assert reason in plan("check", path, code=2)


ITEM = {"type": "SimpleItem", "command": 16, "frame": 3}
MISSION = {"items": [ITEM | {"params": [0, 0, 0, None, north_deg, 121.0, 0]} for north_deg in (36.001, 36.01, 36.02)]}
CORNERS = [[36.003, 120.99], [36.003, 121.01], [35.99, 121.01], [35.99, 120.99]]
FENCED_PLAN = {
    "fileType": "Plan",
    "mission": MISSION,
    "geoFence": {"polygons": [{"inclusion": True, "polygon": CORNERS}]},
}
WARNING = "warning: Mission item 2 is 778 m outside the fence\n"


def test_mission_outside_the_fence_is_a_warning(capsys, tmp_path, state):
    fenced, mission = tmp_path / "fenced.plan", tmp_path / "mission.plan"
    fenced.write_text(json.dumps(FENCED_PLAN))
    mission.write_text(json.dumps({"fileType": "Plan", "mission": MISSION}))
    assert main(["plan", "check", str(fenced)]) == 0
    out, err = capsys.readouterr()
    assert out == f"{fenced}: mission: 3 items, 2 outside the fence\n{fenced}: fence: 4 items, all valid\n"
    assert err.startswith(f"{fenced}: {WARNING}{fenced}: warning: Mission item 3 is 18")
    assert main(["plan", "check", str(mission)]) == 0
    assert capsys.readouterr() == (f"{mission}: mission: 3 items, all valid\n", "")
    waypoints = tmp_path / "a.waypoints"
    waypoints.write_text(WAYPOINTS.replace("\t36.1234567\t121.1", "\t36.01\t121.0"))
    assert main(["plan", "load", str(fenced), "--state", str(state)]) == 0
    capsys.readouterr()
    for words, number in (((), 1), (("--no-home",), 1)):
        assert main(["plan", "load", str(waypoints), "--state", str(state), *words]) == 0
        assert capsys.readouterr().err.startswith(f"{state}: warning: Mission item {number} is 778 m outside")
    for file in (fenced, mission):  # with its own fence, then with the stored fence
        assert main(["plan", "load", str(file), "--state", str(state)]) == 0
        assert capsys.readouterr().err.startswith(f"{state}: {WARNING}")


@pytest.mark.parametrize("text", ['{"version": 1, "polygon": [[1, 2]]}', '{"version": 2, "polygon": []}', "{}"])
def test_invalid_fence_does_not_replace_the_stored_fence(plan, tmp_path, state, text):
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(FENCED_PLAN))
    plan("load", path, "--state", state)
    plans = stored_plans(plan, state)
    path.write_text(f'{{"fileType": "Plan", "mission": {{"items": []}}, "geoFence": {text}}}')
    assert "geoFence: " in plan("load", path, "--state", state, code=2)
    assert stored_plans(plan, state) == plans
    path.write_text('{"fileType": "Plan", "geoFence": {"polygons": [], "circles": []}}')
    assert plan("load", path, "--state", state) == f"{state}: fence: 0 items, 4 removed\n"
