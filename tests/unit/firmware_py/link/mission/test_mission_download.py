"""Plans to a ground station, and how far the mission is."""

import math

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SetMissionItem, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.common.reports import MissionReport, MissionState
from firmware_py.plans.items import TABLE
from firmware_py.plans.validation import PlanResult

GOING = MissionReport(MissionState.ACTIVE, 1, 3, (), (11, 22, 33))


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_every_list_is_empty_at_first(station, kind):
    count = station.listed(kind)
    assert (count.count, count.opaque_id) == (0, 0)
    assert station.read(1, kind).type == PlanResult.INVALID_SEQUENCE


@pytest.mark.parametrize(("identity", "kind"), [(3, 1), (3, 2), (0, 0)])
def test_an_empty_list_without_a_home_has_no_item_0(make_station, identity, kind):
    assert make_station(identity=identity).read(0, kind).type == PlanResult.INVALID_SEQUENCE


@pytest.mark.parametrize("whole", [False, True])
def test_home_can_be_read_without_a_mission_as_dronekit_does(station, home, whole):
    assert station.listed().count == 0
    item = station.read(0, whole=whole)
    assert (item.seq, item.command, item.z) == (0, 16, home.altitude_m)


@pytest.mark.parametrize("identity", [0, 3])
def test_what_was_uploaded_comes_back(make_station, identity):
    station = make_station(identity=identity)
    home = station.home_count
    jump = station.item(3 + home, 177, frame=2, params=(float(home), 5.0, math.nan, 0.0))
    items = [*station.mission(3), jump]
    ack = station.upload(items)
    assert station.listed().opaque_id == ack.opaque_id
    read = station.download()
    assert station.all_fields(read[home:]) == station.all_fields(items[home:])


def test_item_0_is_home(station, home):
    station.upload(station.mission(1))
    first = station.download()[0]
    assert (first.command, first.frame, first.z) == (16, 0, home.altitude_m)
    assert first.x == round(math.degrees(home.latitude_rad) * 1e7)
    assert first.y == round(math.degrees(home.longitude_rad) * 1e7)


def test_home_is_nowhere_before_it_is_set(rig, make_station):
    station = make_station()
    station.upload(station.mission(1))
    station.rig.tick(home=None)
    assert (station.read(0).x, station.read(0).y) == (0, 0)


def test_the_old_request_is_answered_in_degrees(station):
    station.upload([*station.mission(1), station.item(2, 177, frame=2, x=7, y=-7, params=(1.0, 1.0, 0, 0))])
    _, place, jump = station.download(whole=False)
    assert (place.x, place.y) == (pytest.approx(36.0000001, abs=2e-6), pytest.approx(121.0, abs=4e-6))
    assert (jump.x, jump.y, jump.param1) == (7.0, -7.0, 1.0)


def test_the_current_item_is_marked(station):
    station.upload(station.mission(3))
    station.rig.tick(mission=msgspec.structs.replace(GOING, index=1))
    assert [item.current for item in station.download()] == [0, 0, 1, 0]


def test_who_reads_gets_the_whole_of_one_plan(station):
    station.upload(station.mission(2))
    station.listed()
    first = station.read(0), station.read(1)
    kept = station.rig.request_handler
    kept.plans_kept = kept.plans_kept.replaced(Plan(PlanKind.MISSION))
    assert station.read(2).x == first[1].x + 1
    # Until it says that it has all, or falls silent.
    station.rig.tell(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    assert station.read(2).type == PlanResult.INVALID_SEQUENCE


def test_an_old_reading_is_forgotten(station):
    station.upload(station.mission(2))
    station.listed()
    kept = station.rig.request_handler
    kept.plans_kept = kept.plans_kept.replaced(Plan(PlanKind.MISSION))
    station.rig.ticks(160)
    assert station.read(2).type == PlanResult.INVALID_SEQUENCE


def read_part(station, first, last):
    return station.answers(mavlink.MAVLink_mission_request_partial_list_message(1, 1, first, last, 0))


def test_a_part_of_the_list(station):
    station.upload(station.mission(20))
    assert [item.seq for item in read_part(station, 3, 5)] == [3, 4, 5]
    assert [item.seq for item in read_part(station, 19, -1)] == [19, 20]
    for first, last, result in ((5, 3, 13), (-2, 3, 13), (0, 21, 13), (0, -1, PlanResult.NO_SPACE)):
        assert read_part(station, first, last)[0].type == result


@pytest.mark.parametrize("sequence", [0, 3, 65535])
def test_items_that_there_are_not(make_station, sequence):
    station = make_station(identity=0)
    assert station.read(sequence).type == PlanResult.INVALID_SEQUENCE


NEED_OTHERS = ("DO_JUMP", "DO_JUMP_TAG", "CONDITION_DISTANCE")


@st.composite
def good_items(draw):
    """Fields of an item that is accepted as such."""
    row = draw(st.sampled_from([row for row in TABLE if row.name not in NEED_OTHERS and "VERTEX" not in row.name]))
    any_single = st.floats(width=32, allow_infinity=False)
    params = [draw(any_single) for _ in range(4)]
    for meaning in row.meanings:
        span = st.integers(int(max(meaning.low, 0)), int(min(meaning.high, 20)))
        params[meaning.number - 1] = float(draw(span))
    x, y = draw(st.integers(-(9 * 10**8), 9 * 10**8)), draw(st.integers(-(18 * 10**8), 18 * 10**8))
    z = draw(st.floats(-1e4, 1e4, width=32))
    return int(row.kind), int(row.command), draw(st.sampled_from([0, 3, 5, 6])), tuple(params), x, y, z


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(good_items())
def test_any_good_item_goes_and_comes_back(station, fields):
    kind, command, frame, params, x, y, z = fields
    before = [station.item(0)] if kind == 0 else []
    item = station.item(len(before), command, kind=kind, frame=frame, params=params, x=x, y=y, z=z)
    assert station.upload([*before, item], kind).type == 0
    read = station.download(kind)[-1]
    assert station.fields(read)[0:3] == station.fields(item)[0:3]
    sent = mavlink.MAVLink(None).parse_buffer(item.pack(mavlink.MAVLink(None)))[0]  # in single precision
    assert station.fields(read) == station.fields(sent)


# ------------------------------------------------------------------------------ how far the boat is


def current(station, **changes):
    return [m for m in station.rig.tick(**changes) if m.get_type() == "MISSION_CURRENT"]


@pytest.mark.parametrize("identity", [0, 3])
def test_the_current_item_is_reported_at_once_when_it_changes(make_station, identity):
    station = make_station(identity=identity)
    (reports,) = current(station, mission=GOING, mode=Mode.AUTO)
    assert (reports.seq, reports.total, reports.mission_state, reports.mission_mode) == (
        1 + station.home_count,
        3,
        3,
        1,
    )
    assert (reports.mission_id, reports.fence_id, reports.rally_points_id) == (11, 22, 33)
    assert current(station, mission=GOING) == []
    (reports,) = current(station, mission=msgspec.structs.replace(GOING, index=2))
    assert (reports.seq, reports.mission_mode) == (2 + station.home_count, 2)


def test_no_mission_is_reported(station):
    current(station, mission=GOING)
    (reports,) = current(station)
    assert (reports.seq, reports.total, reports.mission_state) == (0, 65535, 1)


def test_reached_items_are_reported(station, make_station):
    reached = msgspec.structs.replace(GOING, reached=(0, 1))
    replies = [m.seq for m in station.rig.tick(mission=reached) if m.get_type() == "MISSION_ITEM_REACHED"]
    assert replies == [1, 2]
    generic = make_station(identity=0)
    replies = [m.seq for m in generic.rig.tick(mission=reached) if m.get_type() == "MISSION_ITEM_REACHED"]
    assert replies == [0, 1]


@pytest.mark.parametrize(("identity", "sequence", "index"), [(3, 2, 1), (3, 1, 0), (3, 0, 0), (0, 2, 2), (0, 0, 0)])
def test_another_item_is_gone_on_with(make_station, identity, sequence, index):
    station = make_station(identity=identity)
    station.rig.tick(mission=GOING)
    station.rig.tell(mavlink.MAVLink_mission_set_current_message(1, 1, sequence))
    assert station.rig.request_handler.intents == [SetMissionItem(index)]
    assert len(current(station, mission=GOING)) == 1  # whether or not it has changed


def test_an_item_that_cannot_be_gone_on_with(station, texts):
    station.rig.request_handler.answer = Answer(Verdict.DENIED, "there is no item 7")
    replies = station.rig.tell(mavlink.MAVLink_mission_set_current_message(1, 1, 8))
    assert texts(replies) == ["there is no item 7"]
    assert len(current(station)) == 1
