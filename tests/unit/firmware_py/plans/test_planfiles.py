"""Plan files: what ground stations write is read, what is broken is refused in one clear line."""

import importlib
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.plans.items import TABLE
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.plan_file import read_plan_file
from firmware_py.plans.qgc_file import read_plan, write_plan
from firmware_py.plans.text_files import read_text, write_text

HOME_LINE = "0\t1\t0\t16\t0\t0\t0\t0\t36.0\t121.0\t5.0\t1\n"
WPL = "QGC WPL 110\n" + HOME_LINE


def wpl(*lines):
    return WPL + "".join(f"{index}\t0\t{line}\t1\n" for index, line in enumerate(lines, start=1))


def simple(number, command, params, frame=3, **more):
    entry = {"type": "SimpleItem", "command": command, "frame": frame, "params": params, "doJumpId": number}
    return entry | {"autoContinue": True, "Altitude": 0, "AltitudeMode": 1, "AMSLAltAboveTerrain": None} | more


def document(items=(), polygons=(), circles=(), points=(), **fence):
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": 3,
            "vehicleType": 11,
            "cruiseSpeed": 15,
            "plannedHomePosition": [36.0, 121.0, 5.0],
            "items": list(items),
        },
        "geoFence": {"version": 2, "polygons": list(polygons), "circles": list(circles), **fence},
        "rallyPoints": {"version": 2, "points": list(points)},
    }


QGC = document(
    items=[
        simple(1, 16, [0, 0, 0, None, 36.1, 121.1, 0]),
        simple(2, 19, [600, 0, 50, 1, 36.2, 121.2, 0], autoContinue=False),
        simple(3, 177, [1, 3, 0, 0, 0, 0, 0], frame=2),
        simple(4, 20, [0, 0, 0, 0, 0, 0, 0], frame=2),
    ],
    polygons=[
        {"version": 1, "inclusion": True, "polygon": [[36.0, 121.0], [36.0, 122.0], [37.0, 121.5]]},
        {"version": 1, "inclusion": False, "polygon": [[36.1, 121.4], [36.1, 121.5], [36.2, 121.5], [36.2, 121.4]]},
    ],
    circles=[{"version": 1, "inclusion": False, "circle": {"center": [36.3, 121.5], "radius": 250.5}}],
    points=[[36.01, 121.02, 0], [36.03, 121.04, 1.5]],
    breachReturn=[36.05, 121.5, 0],
)


def test_a_plan_of_qgroundcontrol():
    mission, fence, rally = read_plan(json.dumps(QGC), "a.plan")
    assert repr(mission.items) == repr(
        (
            PlanItem(16, 3, True, (0.0, 0.0, 0.0, math.nan), 361_000_000, 1_211_000_000, 0.0),
            PlanItem(19, 3, False, (600.0, 0.0, 50.0, 1.0), 362_000_000, 1_212_000_000, 0.0),
            PlanItem(177, 2, True, (0.0, 3.0, 0.0, 0.0)),
            PlanItem(20, 2, True, (0.0, 0.0, 0.0, 0.0)),
        )
    )
    assert [(item.command, item.params[0]) for item in fence.items] == [
        *[(5001, 3.0)] * 3,
        *[(5002, 4.0)] * 4,
        (5004, 250.5),
        (5000, 0.0),
    ]
    assert [(item.command, item.x, item.y, item.z) for item in rally.items] == [
        (5100, 360_100_000, 1_210_200_000, 0.0),
        (5100, 360_300_000, 1_210_400_000, 1.5),
    ]


def test_a_plan_that_is_written_is_read_back():
    plans = Plans()
    for plan in read_plan(json.dumps(QGC), "a.plan"):
        plans = plans.replaced(plan)
    assert read_plan(write_plan(plans), "b.plan") == (plans.mission, plans.fence, plans.rally)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("{", "no JSON"),
        ('{"fileType": "Mission"}', "fileType is not Plan"),
        ('{"fileType": "Plan"}', "neither mission"),
        ('{"fileType": "Plan", "mission": NaN}', "NaN is no JSON"),
        ('{"a": ' * 200_000, "nested too deeply"),  # beyond the depth that any Python from 3.11 to 3.14 reads
        ('{"fileType": "Plan", "mission": []}', "mission: expected an object"),
        ('{"fileType": "Plan", "mission": {"items": {}}}', "mission: items: expected a list"),
        (
            json.dumps(document([{"type": "ComplexItem", "complexItemType": "survey"}])),
            "item 1: 'survey' is not a simple",
        ),
        (json.dumps(document([7])), "item 1: expected an object"),
        (json.dumps(document([simple(1, 16, [0] * 6)])), "item 1: expected 7 params"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, None, 0, 0])])), "item 1: expected a number"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, True, 0, 0])])), "item 1: expected a number"),
        (json.dumps(document([simple(1, 16, [0, 0, 0, 0, 91, 0, 0])])), "item 1: latitude 91 is not"),
        (json.dumps(document([simple(1, 16, [1e39, 0, 0, 0, 0, 0, 0])])), "item 1: param1 is too large"),
        (json.dumps(document([simple(1, 16, [10**400, 0, 0, 0, 0, 0, 0])])), "item 1:"),
        (json.dumps(document([simple(1, 1e9, [0] * 7)])), "item 1: expected a whole number"),
        (json.dumps(document([simple(1, 177, [5, 1, 0, 0, 0, 0, 0])])), "item 1: DO_JUMP: there is no item"),
        (json.dumps(document([simple(1, 177, [None, 1, 0, 0, 0, 0, 0])])), "item 1: DO_JUMP: there is no item"),
        (json.dumps(document([simple(1, 16, [0] * 7, frame=-1)])), "item 1: expected a whole number"),
        (json.dumps(document([simple(1, 16, [0] * 7, autoContinue=1)])), "item 1: expected true or false"),
        (json.dumps(document(polygons=[{"inclusion": True, "polygon": []}])), "geoFence: item 1: the polygon has no"),
        (json.dumps(document(polygons=[{"polygon": [[1, 2]]}])), "geoFence: item 1: expected true or false"),
        (json.dumps(document(circles=[{"inclusion": True, "circle": {"center": [1]}}])), "geoFence: item 1:"),
        (json.dumps(document(points=[[1, 2]])), "rallyPoints: item 1: expected [latitude, longitude, altitude]"),
        (json.dumps(document([simple(1, 16, [0] * 7)] * 2001)), "at most 2000"),
    ],
)
def test_broken_plans_are_refused(text, error):
    with pytest.raises(PlanFileError) as refused:
        read_plan(text, "a.plan")
    assert str(refused.value).startswith("a.plan: ")
    assert error in str(refused.value)
    assert "\n" not in str(refused.value)


def test_waypoints():
    plan = read_text(wpl("3\t16\t0\t5.5\t0\tnan\t36.1234567\t121.1\t0", "2\t177\t1\t-1\t0\t0\t0\t0\t0"), "a.waypoints")
    assert repr(plan.items) == repr(
        (
            PlanItem(16, 3, True, (0.0, 5.5, 0.0, math.nan), 361_234_567, 1_211_000_000, 0.0),
            PlanItem(177, 2, True, (0.0, -1.0, 0.0, 0.0)),
        )
    )
    with_home = read_text(WPL, "a.waypoints", home=False)
    assert [(item.x, item.z) for item in with_home.items] == [(360_000_000, 5.0)]
    assert read_text("# by hand\n\nQGC WPL 110\n", "a") == Plan(PlanKind.MISSION)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "a: this is no plan file"),
        ("QGC WPL 100\n", "a: this is no plan file"),
        (WPL + "1\t0\t3\n", "a:3: 3 columns instead of 12"),
        (WPL + "2\t0\t3\t16\t0\t0\t0\t0\t0\t0\t0\t1\n", "a:3: item '2' where 1 is due"),
        (wpl("3\t16\tx\t0\t0\t0\t0\t0\t0"), "a:3: 'x' is not a number"),
        (wpl("3\t16\t1_0\t0\t0\t0\t0\t0\t0"), "a:3: '1_0' is not a number"),
        (wpl("3\t16\t0\t0\t0\t0\tnan\t0\t0"), "a:3: latitude nan is not within"),
        (wpl("3\t16\t0\t0\t0\t0\t0\t181\t0"), "a:3: longitude 181 is not within"),
        (wpl("256\t16\t0\t0\t0\t0\t0\t0\t0"), "a:3: '256' is not a whole number"),
        (wpl("3\t16.5\t0\t0\t0\t0\t0\t0\t0"), "a:3: '16.5' is not a whole number"),
        (wpl("3\t16\t1e300\t0\t0\t0\t0\t0\t0"), "a:3: param1 is too large"),
        ("RALLY 1 2 3\n", "a:1: expected RALLY"),
        ("RALLY 1 2 3 4 5 6\n7 8\n", "a:2: expected RALLY"),
        ("1 2\n1 2\n", "a: a fence is its return point"),
        ("1 2\n1 2\n1 3\n2 3\n2 2\n", "a: a fence is its return point"),
        ("1 2\n1 2 3\n", "a:2: expected LATITUDE LONGITUDE"),
    ],
)
def test_broken_text_files_are_refused(text, error):
    with pytest.raises(PlanFileError) as refused:
        read_text(text, "a")
    assert str(refused.value).startswith(error)


# ------------------------------------------------------------------- pymavlink as the oracle


@pytest.fixture
def mavwp(monkeypatch):
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil = importlib.import_module("pymavlink.mavutil")
    mavutil.set_dialect("ardupilotmega")
    return importlib.import_module("pymavlink.mavwp")


MISSION = Plan.of(
    PlanKind.MISSION,
    [
        PlanItem(16, 3, True, (1.0, 2.5, 0.0, 0.0), 361_234_567, -1_211_234_567, 1.25),
        PlanItem(18, 0, False, (3.0, 0.0, -20.0, 0.0), -1, 2, 0.0),
        PlanItem(177, 2, True, (1.0, 5.0, 0.0, 0.0)),
    ],
)
CORNERS = ((0, 0), (0, 900_000), (900_000, 450_000))
FENCE = Plan.of(
    PlanKind.FENCE,
    [
        *(PlanItem(5001, 0, True, (3.0, 0.0, 0.0, 0.0), x, y) for x, y in CORNERS),
        PlanItem(5004, 0, True, (12.5, 0.0, 0.0, 0.0), 300_000, 450_000),
    ],
)
RALLY = Plan.of(PlanKind.RALLY, [PlanItem(5100, 3, True, x=5_000_000, y=-7_000_000, z=2.0)])


@pytest.mark.parametrize(
    ("plan", "loader"),
    [(MISSION, "MAVWPLoader"), (FENCE, "MissionItemProtocol_Fence"), (RALLY, "MissionItemProtocol_Rally")],
)
def test_pymavlink_reads_what_is_written_and_writes_what_is_read(tmp_path, mavwp, plan, loader):
    path = tmp_path / "plan.waypoints"
    path.write_text(write_text(plan))
    oracle = getattr(mavwp, loader)()
    before = int(plan.kind is PlanKind.MISSION)
    assert oracle.load(str(path)) == len(plan.items) + before
    for index, item in enumerate(plan.items):
        seen = oracle.wp(index + before)
        first = item.params[0] + (before if item.command == 177 else 0)
        assert (seen.command, seen.frame, seen.autocontinue) == (item.command, item.frame, item.autocontinue)
        assert (seen.param1, seen.param2, seen.param3, seen.param4) == (first, *item.params[1:])
        assert seen.z == item.z
        assert [round(seen.x * 1e7), round(seen.y * 1e7)] == [item.x, item.y]
    oracle.save(str(tmp_path / "again.txt"))
    (again,) = read_plan_file((tmp_path / "again.txt").read_bytes(), "again.txt")
    assert [(item.command, item.params) for item in again.items] == [(item.command, item.params) for item in plan.items]
    assert all(abs(one.x - other.x) <= 5 for one, other in zip(again.items, plan.items, strict=True))  # it writes %f


def test_older_fences_and_rally_points_are_read_as_pymavlink_reads_them(tmp_path, mavwp):
    path = tmp_path / "fence.txt"
    path.write_text("# a fence\n36.05 121.5\n36.0 121.0\n36.0 122.0\n37.0 121.5\n36.0 121.0\n")
    oracle = mavwp.MissionItemProtocol_Fence()
    oracle.load(str(path))
    (fence,) = read_plan_file(path.read_bytes(), "fence.txt")
    assert [(item.command, item.params[0]) for item in fence.items] == [(w.command, w.param1) for w in oracle.wpoints]
    assert all(
        abs(item.x - w.x) <= 1 and abs(item.y - w.y) <= 1 for item, w in zip(fence.items, oracle.wpoints, strict=True)
    )
    path.write_text("RALLY 36.1 121.1 1.5 0 0 0\nRALLY 36.2 -121.2 0 0 0 0\n")
    (rally,) = read_plan_file(path.read_bytes(), "rally.txt")
    assert [(item.x, item.y, item.z) for item in rally.items] == [
        (361_000_000, 1_211_000_000, 1.5),
        (362_000_000, -1_212_000_000, 0.0),
    ]


@st.composite
def plan_items(draw):
    row = draw(st.sampled_from([row for row in TABLE if row.kind is PlanKind.MISSION and row.name != "DO_JUMP"]))
    params = draw(st.tuples(*[st.floats(width=32, allow_infinity=False)] * 4))
    x, y = draw(st.integers(-(9 * 10**8), 9 * 10**8)), draw(st.integers(-(18 * 10**8), 18 * 10**8))
    z = draw(st.floats(width=32, allow_infinity=False))
    return PlanItem(int(row.command), draw(st.integers(0, 255)), draw(st.booleans()), params, x, y, z)


@given(st.lists(plan_items(), max_size=4))
def test_every_item_survives_both_formats(items):
    plan = Plan.of(PlanKind.MISSION, items)
    assert read_text(write_text(plan), "a") == plan
    through_json = read_plan(write_plan(Plans(mission=plan)), "b")[0]
    assert through_json == plan


@given(
    st.binary(max_size=300)
    | st.text(max_size=300).map(str.encode)
    | st.text(max_size=200).map(lambda t: (WPL + t).encode())
)
def test_any_bytes_are_read_or_refused(content):
    text = content.decode("utf-8", "replace")
    for read in (read_plan, read_text):
        try:
            read(text, "a")
        except PlanFileError:
            pass


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(
    json_values,
    st.sampled_from(["mission", "geoFence", "rallyPoints"]),
    st.sampled_from(["items", "polygons", "points"]),
)
def test_any_json_is_read_or_refused(value, section, key):
    for text in (
        json.dumps({"fileType": "Plan", section: value}),
        json.dumps({"fileType": "Plan", section: {key: [value]}}),
    ):
        try:
            read_plan(text, "a")
        except PlanFileError:
            pass


def test_files_that_cannot_be_read(tmp_path):
    huge, binary, wrong = tmp_path / "huge", tmp_path / "binary", tmp_path / "wrong.waypoints"
    huge.write_bytes(b"1 2\n" * (3 << 20))
    binary.write_bytes(b"\xff\xfe\x00")
    wrong.write_text(wpl("3\t16\t0\t0\t0\t0\t1\t2\t0", "1\t16\t0\t0\t0\t0\t1\t2\t0"))
    for path, error in (
        (huge, "larger than"),
        (binary, "this is no text"),
        (wrong, "mission: item 1: NAV_WAYPOINT: frame 1 is not supported"),
    ):
        with pytest.raises(PlanFileError, match=error):
            read_plan_file(path.read_bytes(), path.name)
