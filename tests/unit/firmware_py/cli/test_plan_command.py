"""`rambler plan`: check, load, show and save."""

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


def output_of(capsys, *words, code=0):
    assert main(["plan", *map(str, words)]) == code
    captured = capsys.readouterr()
    return captured.err if code else captured.out


def plans_in(capsys, state):
    return json.loads(output_of(capsys, "show", "--json", "--state", state))


def test_plan_is_loaded_shown_and_saved(capsys, tmp_path, file, state):
    assert output_of(capsys, "check", file) == f"{file}: mission: 2 items, all valid\n"
    assert output_of(capsys, "load", file, "--state", state) == f"{state}: mission: 2 items\n"
    first, jump = plans_in(capsys, state)["mission"]
    assert (first["latitude_deg"], first["params"]) == (36.1234567, [0.0, 5.5, 0.0, None])
    assert (jump["name"], jump["params"]) == ("DO_JUMP", [0.0, -1.0, 0.0, 0.0])
    assert "NAV_WAYPOINT" in output_of(capsys, "show", "--state", state)
    before = plans_in(capsys, state)
    for name in ("b.plan", "b.waypoints"):
        output_of(capsys, "save", tmp_path / name, "--state", state)
        assert json.loads(output_of(capsys, "check", "--json", tmp_path / name))["mission"] == before["mission"]
        output_of(capsys, "load", tmp_path / name, "--state", state)
        assert plans_in(capsys, state) == before


def test_refused_plan_changes_nothing(capsys, file, state):
    output_of(capsys, "load", file, "--state", state)
    before = plans_in(capsys, state)
    file.write_text(WAYPOINTS.replace("\t177\t1\t", "\t177\t9\t"))
    error = output_of(capsys, "load", file, "--state", state, code=2)
    text = "item 2: DO_JUMP: the target item does not exist; correct it (home is item 0)"
    assert error == f"rambler plan load: {file}: mission: {text}\n"
    assert plans_in(capsys, state) == before


def test_state_in_use_is_not_changed_but_shown(capsys, file, state):
    store = Store(state)
    try:
        error = output_of(capsys, "load", file, "--state", state, code=2)
        assert "in use" in error
        assert "ground station" in error
        assert plans_in(capsys, state) == {"mission": [], "fence": [], "rally": []}
    finally:
        store.close()


def test_write_error_is_one_line(capsys, file, state, monkeypatch):
    def no_room(*_words):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", no_room)
    error = output_of(capsys, "load", file, "--state", state, code=2)
    assert "cannot be stored" in error
    assert error.count("\n") == 1


def test_table_of_items_is_complete(capsys):
    table = output_of(capsys, "items")
    assert all(f"| {row.name} | {int(row.command)} |" in table for row in TABLE)


def test_damaged_plan_is_named(capsys, file, state):
    for _ in range(2):
        output_of(capsys, "load", file, "--state", state)
    (state / "mission.plan.1").write_bytes(bytes(4096))
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: the other slot is used" in capsys.readouterr().err
    (state / "mission.plan.0").unlink()
    main(["plan", "show", "--state", str(state)])
    assert "mission.plan.1 is damaged: no plan remains" in capsys.readouterr().err


def test_unusable_state_directories(capsys, file, tmp_path, state):
    error = output_of(capsys, "show", "--state", tmp_path / "none", code=2)
    assert error.endswith(f"{tmp_path / 'none'} does not exist; give that of `rambler run --state`, or create it: "
                         f"mkdir -p {tmp_path / 'none'}\n")  # fmt: skip
    assert "is a file; give that of" in output_of(capsys, "load", file, "--state", file, code=2)
    output_of(capsys, "load", file, "--state", tmp_path / "a" / "new", code=0)
    assert len(plans_in(capsys, tmp_path / "a" / "new")["mission"]) == 2
    store = Store(state)
    store.save("mission.plan", b"nonsense")
    store.close()
    assert "load the plan again" in output_of(capsys, "show", "--state", state, code=2)
    output_of(capsys, "load", file, "--state", state)
    assert "Is a directory" in output_of(capsys, "save", tmp_path, "--state", state, code=2)
    assert "see rambler plan" in output_of(capsys, "show", code=2)


def test_unreadable_file_is_named(capsys, tmp_path):
    assert "No such file" in output_of(capsys, "check", tmp_path / "none", code=2)
    assert "Is a directory" in output_of(capsys, "check", tmp_path, code=2)
    huge = tmp_path / "huge"
    huge.write_bytes(b"1 2\n" * (3 << 20))
    assert "larger than" in output_of(capsys, "check", huge, code=2)


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


def test_mission_outside_the_fence_is_a_warning(capsys, tmp_path, state):
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
def test_invalid_fence_leaves_the_old_one(capsys, tmp_path, state, text):
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(OUTSIDE))
    main(["plan", "load", str(path), "--state", str(state)])
    capsys.readouterr()
    before = plans_in(capsys, state)
    path.write_text(f'{{"fileType": "Plan", "mission": {{"items": []}}, "geoFence": {text}}}')
    assert "geoFence: " in output_of(capsys, "load", path, "--state", state, code=2)
    assert plans_in(capsys, state) == before
    path.write_text('{"fileType": "Plan", "geoFence": {"polygons": [], "circles": []}}')
    assert output_of(capsys, "load", path, "--state", state) == f"{state}: fence: 0 items, 4 removed\n"
