"""Download of plans, and reports of the mission's progress."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SetMissionItem, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.common.reports import MissionReport, MissionState
from firmware_py.plans.items import TABLE, Command
from firmware_py.plans.validation import PlanResult

INVALID, NO_SPACE = PlanResult.INVALID_SEQUENCE, PlanResult.NO_SPACE
ACTIVE = MissionReport(MissionState.ACTIVE, 1, 3, (), (11, 22, 33))
BOTH_IDENTITIES = pytest.mark.parametrize("identity", [0, 3])


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_lists_are_empty_at_first(station, kind):
    count = station.request_list(kind)
    assert (count.count, count.opaque_id) == (0, 0)
    assert station.read(1, kind).type == PlanResult.INVALID_SEQUENCE


@pytest.mark.parametrize(("identity", "kind", "sequence"), [(3, 1, 0), (3, 2, 0), (0, 0, 0), (0, 0, 3), (0, 0, 65535)])
def test_item_that_does_not_exist_is_refused(make_station, identity, kind, sequence):
    assert make_station(identity=identity).read(sequence, kind).type == PlanResult.INVALID_SEQUENCE


@pytest.mark.parametrize("is_int", [False, True])
def test_home_is_readable_without_a_mission(station, home, is_int):
    """DroneKit reads it in this way."""
    assert station.request_list().count == 0
    item = station.read(0, is_int=is_int)
    assert (item.seq, item.command, item.z) == (0, Command.WAYPOINT, home.altitude_m)


@BOTH_IDENTITIES
def test_download_returns_the_uploaded_items(make_station, identity):
    station = make_station(identity=identity)
    home = station.home_count
    jump = station.item(3 + home, Command.JUMP, frame=2, params=(float(home), 5.0, math.nan, 0.0))
    items = [*station.mission(3), jump]
    ack = station.upload(items)
    assert station.request_list().opaque_id == ack.opaque_id
    assert station.all_fields(station.download()[home:]) == station.all_fields(items[home:])


def test_item_0_is_home_or_0_0_without_home(station, home):
    station.upload(station.mission(1))
    item = station.download()[0]
    assert (item.command, item.frame, item.z) == (Command.WAYPOINT, 0, home.altitude_m)
    assert item.x == round(math.degrees(home.latitude_rad) * 1e7)
    assert item.y == round(math.degrees(home.longitude_rad) * 1e7)
    station.rig.tick(home=None)
    assert (station.read(0).x, station.read(0).y) == (0, 0)


def test_mission_request_gets_items_in_degrees(station):
    station.upload([*station.mission(1), station.item(2, Command.JUMP, frame=2, x=7, y=-7, params=(1.0, 1.0, 0, 0))])
    _, waypoint, jump = station.download(is_int=False)
    assert (waypoint.x, waypoint.y) == (pytest.approx(36.0000001, abs=2e-6), pytest.approx(121.0, abs=4e-6))
    assert (jump.x, jump.y, jump.param1) == (7.0, -7.0, 1.0)


def test_current_item_is_marked(station):
    station.upload(station.mission(3))
    station.rig.tick(mission=replace(ACTIVE, index=1))
    assert [item.current for item in station.download()] == [0, 0, 1, 0]


@pytest.mark.parametrize("end", ["acknowledged", "silent", "sixteen others"])
def test_plan_of_a_download_is_unchanged_until_its_end(station, end):
    station.upload(station.mission(2))
    station.request_list()
    station.handler.stored_plans = station.handler.stored_plans.replaced(Plan(PlanKind.MISSION))
    system = station.rig.station.srcSystem
    for other in range(15):
        station.rig.station.srcSystem = 1 + other
        station.request_list()
    station.rig.station.srcSystem = system
    station.rig.now_s += 14.9
    assert station.read(2).x == station.item(2).x
    if end == "acknowledged":
        station.rig.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    elif end == "silent":
        station.rig.now_s += 15.0
    else:
        station.rig.station.srcSystem = 100
        station.request_list()
        station.rig.station.srcSystem = system
    assert station.read(2).type == PlanResult.INVALID_SEQUENCE


def test_requested_part_of_the_list_is_sent(station):
    def read_part(first, last):
        return station.exchange(mavlink.MAVLink_mission_request_partial_list_message(1, 1, first, last, 0))

    station.upload(station.mission(20))
    assert [item.seq for item in read_part(3, 5)] == [3, 4, 5]
    assert [item.seq for item in read_part(19, -1)] == [19, 20]
    assert [item.seq for item in read_part(0, 15)] == list(range(16))
    for first, last, result in (
        (5, 3, INVALID),
        (-2, 3, INVALID),
        (0, 21, INVALID),
        (0, 16, NO_SPACE),
        (0, -1, NO_SPACE),
    ):
        assert read_part(first, last)[0].type == result


@st.composite
def valid_items(draw):
    """Fields of an item that is valid without other items."""
    need_others = ("DO_JUMP", "DO_JUMP_TAG", "CONDITION_DISTANCE")
    row = draw(st.sampled_from([row for row in TABLE if row.name not in need_others and "VERTEX" not in row.name]))
    params = [draw(st.floats(width=32, allow_infinity=False)) for _ in range(4)]
    for meaning in row.meanings:
        span = st.integers(int(max(meaning.low, 0)), int(min(meaning.high, 20)))
        params[meaning.number - 1] = float(draw(span))
    x, y = draw(st.integers(-(9 * 10**8), 9 * 10**8)), draw(st.integers(-(18 * 10**8), 18 * 10**8))
    z = draw(st.floats(-1e4, 1e4, width=32))
    return int(row.kind), int(row.command), draw(st.sampled_from([0, 3, 5, 6])), tuple(params), x, y, z


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(valid_items())
def test_any_valid_item_is_uploaded_and_downloaded_unchanged(station, fields):
    kind, command, frame, params, x, y, z = fields
    home = [station.item(0)] if kind == 0 else []
    item = station.item(len(home), command, kind=kind, frame=frame, params=params, x=x, y=y, z=z)
    assert station.upload([*home, item], kind).type == 0
    # Encoded and decoded once, the sent item is in single precision, too.
    sent = mavlink.MAVLink(None).parse_buffer(item.pack(mavlink.MAVLink(None)))[0]
    assert station.fields(station.download(kind)[-1]) == station.fields(sent)


# ---------------------------------------------------------------------- progress


def current_reports(station, **changes):
    return [m for m in station.rig.tick(**changes) if m.get_type() == "MISSION_CURRENT"]


@BOTH_IDENTITIES
def test_mission_current_is_sent_at_once_after_a_change(make_station, identity):
    station = make_station(identity=identity)
    (report,) = current_reports(station, mission=ACTIVE, mode=Mode.AUTO)
    assert (report.seq, report.total) == (1 + station.home_count, 3)
    assert (report.mission_state, report.mission_mode) == (3, 1)  # active, in mission mode
    assert (report.mission_id, report.fence_id, report.rally_points_id) == (11, 22, 33)
    assert current_reports(station, mission=ACTIVE) == []
    (report,) = current_reports(station, mission=replace(ACTIVE, index=2))
    assert (report.seq, report.mission_mode) == (2 + station.home_count, 2)  # suspended: not in AUTO
    (report,) = current_reports(station)  # without a mission
    assert (report.seq, report.total, report.mission_state) == (0, 65535, 1)  # number of items unknown, no mission


@BOTH_IDENTITIES
def test_reached_items_are_reported(make_station, identity):
    station = make_station(identity=identity)
    replies = station.rig.tick(mission=replace(ACTIVE, reached_items=(0, 1)))
    first = station.home_count
    assert [m.seq for m in replies if m.get_type() == "MISSION_ITEM_REACHED"] == [first, first + 1]


@pytest.mark.parametrize(("identity", "sequence", "index"), [(3, 2, 1), (3, 1, 0), (3, 0, 0), (0, 2, 2), (0, 0, 0)])
def test_set_current_continues_with_an_item(make_station, identity, sequence, index):
    station = make_station(identity=identity)
    station.rig.tick(mission=ACTIVE)
    station.rig.send(mavlink.MAVLink_mission_set_current_message(1, 1, sequence))
    assert station.handler.intents == [SetMissionItem(index)]
    assert len(current_reports(station, mission=ACTIVE)) == 1  # also without a change


@pytest.mark.parametrize(
    ("reason", "text"), [("there is no item 7", "there is no item 7"), ("", "Mission item 8 refused")]
)
def test_refused_set_current_is_reported(station, texts, reason, text):
    station.handler.answer = Answer(Verdict.DENIED, reason)
    replies = station.rig.send(mavlink.MAVLink_mission_set_current_message(1, 1, 8))
    assert texts(replies) == [text]
    assert len(current_reports(station)) == 1
