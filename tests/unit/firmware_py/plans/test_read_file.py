"""Plan files of all formats: comparison with pymavlink, arbitrary content, camera items."""

import contextlib
import importlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.plans.items import TABLE
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import read_plan, write_plan
from firmware_py.plans.read_file import read_plan_file
from firmware_py.plans.text_files import read_text, write_text

# MAV_CMD.
WAYPOINT, LOITER_UNLIMITED, LOITER_TURNS, JUMP = 16, 17, 18, 177
TRIGGER_DISTANCE, IMAGE_CAPTURE, UNUSED_NUMBER = 206, 2000, 42  # two of cameras
INCLUDED_VERTEX, EXCLUDED_CIRCLE, RALLY_POINT = 5001, 5004, 5100

HEADER = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36.0\t121.0\t5.0\t1\n"


FENCE_HEADER = b"QGC WPL 110\n0\t0\t0\t5003\t9\t0\t0\t0\t1\t2\t0\t1\n"
CAMERA_IN_FENCE = FENCE_HEADER + b"1\t0\t0\t5004\t9\t0\t0\t0\t1\t2\t0\t1\n2\t0\t3\t206\t0\t0\t0\t0\t1\t2\t0\t1\n"


@pytest.fixture
def mavwp(monkeypatch):
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil = importlib.import_module("pymavlink.mavutil")
    mavutil.set_dialect("ardupilotmega")
    return importlib.import_module("pymavlink.mavwp")


MISSION = Plan.of(
    PlanKind.MISSION,
    [
        PlanItem(WAYPOINT, 3, True, (1.0, 2.5, 0.0, 0.0), 361_234_567, -1_211_234_567, 1.25),
        PlanItem(LOITER_TURNS, 0, False, (3.0, 0.0, -20.0, 0.0), -1, 2, 0.0),
        PlanItem(JUMP, 2, True, (1.0, 5.0, 0.0, 0.0)),
    ],
)
CORNERS = ((0, 0), (0, 900_000), (900_000, 450_000))
FENCE = Plan.of(
    PlanKind.FENCE,
    [
        *(PlanItem(INCLUDED_VERTEX, 0, True, (3.0, 0.0, 0.0, 0.0), x, y) for x, y in CORNERS),
        PlanItem(EXCLUDED_CIRCLE, 0, True, (12.5, 0.0, 0.0, 0.0), 300_000, 450_000),
    ],
)
RALLY = Plan.of(PlanKind.RALLY, [PlanItem(RALLY_POINT, 3, True, x=5_000_000, y=-7_000_000, z=2.0)])


@pytest.mark.parametrize(
    ("plan", "loader"),
    [(MISSION, "MAVWPLoader"), (FENCE, "MissionItemProtocol_Fence"), (RALLY, "MissionItemProtocol_Rally")],
)
def test_written_file_is_read_by_pymavlink_and_its_file_is_read(tmp_path, mavwp, plan, loader):
    path = tmp_path / "plan.waypoints"
    path.write_text(write_text(plan))
    oracle = getattr(mavwp, loader)()
    home_count = int(plan.kind is PlanKind.MISSION)
    assert oracle.load(str(path)) == len(plan.items) + home_count
    for index, item in enumerate(plan.items):
        waypoint = oracle.wp(index + home_count)
        param1 = item.params[0] + (home_count if item.command == JUMP else 0)
        assert (waypoint.command, waypoint.frame, waypoint.autocontinue) == (
            item.command,
            item.frame,
            item.autocontinue,
        )
        assert (waypoint.param1, waypoint.param2, waypoint.param3, waypoint.param4) == (param1, *item.params[1:])
        assert waypoint.z == item.z
        assert [round(waypoint.x * 1e7), round(waypoint.y * 1e7)] == [item.x, item.y]
    oracle.save(str(tmp_path / "saved.txt"))
    (saved_plan,) = read_plan_file((tmp_path / "saved.txt").read_bytes(), "saved.txt")
    assert [(item.command, item.params) for item in saved_plan.items] == [
        (item.command, item.params) for item in plan.items
    ]
    assert all(
        abs(saved.x - item.x) <= 5 for saved, item in zip(saved_plan.items, plan.items, strict=True)
    )  # pymavlink writes %f


def test_older_fence_and_rally_files_are_read_as_by_pymavlink(tmp_path, mavwp):
    path = tmp_path / "fence.txt"
    path.write_text("# a fence\n36.05 121.5\n36.0 121.0\n36.0 122.0\n37.0 121.5\n36.0 121.0\n")
    oracle = mavwp.MissionItemProtocol_Fence()
    oracle.load(str(path))
    (fence,) = read_plan_file(path.read_bytes(), "fence.txt")
    assert [(item.command, item.params[0]) for item in fence.items] == [(w.command, w.param1) for w in oracle.wpoints]
    assert {(item.frame, item.autocontinue, item.params[1:]) for item in fence.items} == {(0, True, (0.0, 0.0, 0.0))}
    assert all(
        abs(item.x - w.x) <= 1 and abs(item.y - w.y) <= 1 for item, w in zip(fence.items, oracle.wpoints, strict=True)
    )
    path.write_text("RALLY 36.1 121.1 1.5 0 0 0\nRALLY 36.2 -121.2 0 0 0 0\n")
    (rally,) = read_plan_file(path.read_bytes(), "rally.txt")
    assert rally.items == (
        PlanItem(RALLY_POINT, 3, True, (0.0, 0.0, 0.0, 0.0), 361_000_000, 1_211_000_000, 1.5),
        PlanItem(RALLY_POINT, 3, True, (0.0, 0.0, 0.0, 0.0), 362_000_000, -1_212_000_000, 0.0),
    )


@st.composite
def plan_items(draw):
    row = draw(st.sampled_from([row for row in TABLE if row.kind is PlanKind.MISSION and row.name != "DO_JUMP"]))
    params = draw(st.tuples(*[st.floats(width=32, allow_infinity=False)] * 4))
    x, y = draw(st.integers(-(9 * 10**8), 9 * 10**8)), draw(st.integers(-(18 * 10**8), 18 * 10**8))
    z = draw(st.floats(width=32, allow_infinity=False))
    return PlanItem(int(row.command), draw(st.integers(0, 255)), draw(st.booleans()), params, x, y, z)


@given(st.lists(plan_items(), max_size=4))
def test_any_item_is_unchanged_in_both_formats(items):
    plan = Plan.of(PlanKind.MISSION, items)
    assert read_text(write_text(plan), "a") == plan
    assert read_plan(write_plan(Plans(mission=plan)), "b")[0] == plan


@given(
    st.binary(max_size=300)
    | st.text(max_size=300).map(str.encode)
    | st.text(max_size=200).map(lambda t: (HEADER + t).encode())
)
def test_any_bytes_are_read_or_refused(content):
    text = content.decode("utf-8", "replace")
    for read in (read_plan, read_text):
        with contextlib.suppress(PlanFileError):
            read(text, "a")


def test_invalid_file_is_refused():
    lines = "".join(f"{n}\t0\t{frame}\t16\t0\t0\t0\t0\t1\t2\t0\t1\n" for n, frame in ((1, 3), (2, 1)))
    for content, error in (
        (b" " * ((8 << 20) + 1), "larger than 8 MiB: not a plan file"),
        (b" " * (8 << 20), "not a supported plan file"),
        (FENCE_HEADER + b"1\t0\t0\t5001\t2\t0\t0\t0\t1\t2\t0\t1\n", "fence: item 1: .* param1 is 2;.*counted from 0"),
        (CAMERA_IN_FENCE, "fence: item 2: command 206 is not known"),
        (b"\xff\xfe\x00", "not a text file"),
        ((HEADER + lines).encode(), "mission: item 2: NAV_WAYPOINT: frame 1 is not supported.*home is item 0"),
    ):
        with pytest.raises(PlanFileError, match=error):
            read_plan_file(content, "a.waypoints")
    with pytest.raises(PlanFileError, match=r"mission: item 2: .*items are counted from 0"):
        read_plan_file((HEADER + lines).encode(), "a.waypoints", home=False)


def waypoints(*rows):
    """Return a mission: home, then a line for each command with its param1."""
    lines = [f"{n}\t0\t3\t{command}\t{param1}\t1\t0\t0\t0\t0\t0\t1\n" for n, (command, param1) in enumerate(rows, 1)]
    return (HEADER + "".join(lines)).encode()


def test_camera_items_are_skipped_and_jumps_keep_their_targets():
    texts = []
    rows = [
        (TRIGGER_DISTANCE, 25),
        (WAYPOINT, 0),
        (JUMP, 6),
        (TRIGGER_DISTANCE, 0),
        (IMAGE_CAPTURE, 0),
        (WAYPOINT, 0),
        (JUMP, 1),
        (LOITER_UNLIMITED, 0),
    ]
    (plan,) = read_plan_file(waypoints(*rows), "a.waypoints", note=texts.append)
    assert [(item.command, item.params[0]) for item in plan.items] == [
        (WAYPOINT, 0),
        (JUMP, 2),
        (WAYPOINT, 0),
        (JUMP, 0),
        (LOITER_UNLIMITED, 0),
    ]
    assert texts == ["a.waypoints: mission: camera items skipped: 3 (MAV_CMD 206, 2000); the boat has no camera"]


@pytest.mark.parametrize(
    ("rows", "error"),
    [
        ([(TRIGGER_DISTANCE, 25), (WAYPOINT, -1)], "mission: item 2: NAV_WAYPOINT: param1 is -1"),
        ([(TRIGGER_DISTANCE, 25), (WAYPOINT, 0), (JUMP, 9)], "mission: item 3: DO_JUMP: the target item"),
        ([(TRIGGER_DISTANCE, 25), (WAYPOINT, 0), (JUMP, 1.5)], "mission: item 3: DO_JUMP: param1 is 0.5"),
        ([(TRIGGER_DISTANCE, 25), (WAYPOINT, 0), (JUMP, 0)], "mission: item 3: DO_JUMP: param1 is -1"),
        ([(TRIGGER_DISTANCE, 25), (WAYPOINT, 0), (JUMP, "nan")], "mission: item 3: DO_JUMP: param1 is nan"),
        (
            [(WAYPOINT, 0), (JUMP, 3), (TRIGGER_DISTANCE, 25)],
            "mission: item 2: DO_JUMP: the target item does not exist",
        ),
        ([(TRIGGER_DISTANCE, 25), (TRIGGER_DISTANCE, 0)], "only camera commands"),
        ([(UNUSED_NUMBER, 0)], "command 42 is not known in a mission"),
    ],
)
def test_problem_has_the_item_number_of_the_file(rows, error):
    texts = []
    with pytest.raises(PlanFileError, match=error):
        read_plan_file(waypoints(*rows), "a", note=texts.append)
    assert texts == []


def test_camera_item_without_a_place_is_skipped():
    trigger = {"type": "SimpleItem", "command": IMAGE_CAPTURE, "frame": 2, "params": [0, 1, 1, None, None, None, None]}
    waypoint = {"type": "SimpleItem", "command": WAYPOINT, "frame": 3, "params": [0, 0, 0, None, 1, 2, 0]}
    text = json.dumps({"fileType": "Plan", "mission": {"version": 2, "items": [trigger, waypoint]}})
    assert [item.command for item in read_plan_file(text.encode(), "a.plan")[0].items] == [WAYPOINT]
