"""Commands on home, mission and fence."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SetMissionItem, SetMode, Verdict
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.reports import Home, MissionReport, MissionState
from firmware_py.link.commands.steering import home_request, position_goal
from support.link import results

ACCEPTED, TEMPORARILY_REJECTED, DENIED, _UNSUPPORTED, FAILED = range(5)  # MAV_RESULT
AUTO = 10
MISSION_START, CHANGE_SPEED = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_CHANGE_SPEED
SET_HOME, SET_CURRENT_ITEM = mavlink.MAV_CMD_DO_SET_HOME, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
PLAN = Plan.of(PlanKind.MISSION, [PlanItem(mavlink.MAV_CMD_NAV_WAYPOINT, 6, x=index, y=1) for index in range(5)])


def store_mission(rig, *, is_reported=True):
    """Store a mission of five items; with `is_reported` the snapshot of the last tick has it too."""
    rig.request_handler.stored_plans = rig.request_handler.stored_plans.replaced(PLAN)
    rig.tick(mission=MissionReport(MissionState.ACTIVE, 2, 5) if is_reported else MissionReport())


@pytest.mark.parametrize(("number", "limit"), [(0, 90.0), (1, 180.0), (2, 1e4)])
def test_positions_of_home_and_goals_have_limits(number, limit):
    assert home_request(45.0, 9.0, math.nan).altitude_m == 0.0
    assert not isinstance(home_request(0.0, 9.0, 2.0), str)
    assert not isinstance(home_request(45.0, 0.0, 2.0), str)
    for value, is_valid in ((limit, True), (-limit, True), (1.0001 * limit, False), (-1.0001 * limit, False)):
        position = [45.0, 9.0, 2.0]
        position[number] = value
        requests = [home_request(*position), *([position_goal(*position[:2])] if number < 2 else [])]
        assert {isinstance(request, str) for request in requests} == {not is_valid}


def test_set_home_position_sets_and_reports_home(rig, of, texts):
    position = (450_000_000, -1_200_000_000, 2_000)
    rig.send(mavlink.MAVLink_set_home_position_message(1, *position, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0))
    (home,) = rig.request_handler.intents
    assert (home.latitude_rad, home.altitude_m) == pytest.approx((math.radians(45), 2.0))
    replies = rig.tick(home=Home(home.latitude_rad, home.longitude_rad, 2.0))
    assert len(of(replies, "HOME_POSITION")) == len(of(replies, "GPS_GLOBAL_ORIGIN")) == 1
    assert of(replies, "GPS_GLOBAL_ORIGIN")[0].latitude == 450_000_000
    replies = rig.send(mavlink.MAVLink_set_home_position_message(1, 0, 0, 0, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0))
    assert texts(replies) == ["SET_HOME_POSITION: home at 0, 0 is not accepted"]
    assert len(rig.request_handler.intents) == 1


def test_unchanged_home_is_reported_once_after_a_command(rig, of):
    home = {"home": Home(0.5, 0.2, 0.0)}
    assert len(of(rig.tick(**home), "HOME_POSITION")) == 1
    assert of(rig.tick(**home), "HOME_POSITION") == []
    assert results(rig.command(SET_HOME, 1)) == [ACCEPTED]
    assert len(of(rig.tick(**home), "HOME_POSITION")) == 1
    assert of(rig.tick(**home), "HOME_POSITION") == []


@pytest.mark.parametrize(
    ("first", "last", "intents"),
    [(0, 0, [SetMode(AUTO)]), (1, 0, [SetMode(AUTO), SetMissionItem(0)]), (4, 5, [SetMode(AUTO), SetMissionItem(3)])],
)
def test_mission_starts_at_the_requested_item(rig, first, last, intents):
    store_mission(rig)
    assert results(rig.command(MISSION_START, first, last)) == [ACCEPTED]
    assert rig.request_handler.intents == intents


def test_mission_starts_before_a_tick_has_reported_it(rig):
    """MAVSDK names the last item immediately after the upload."""
    store_mission(rig, is_reported=False)
    assert results(rig.command(MISSION_START, 0, 5)) == [ACCEPTED]


@pytest.mark.parametrize(
    "values", [(6, 0), (0, 3), (math.nan, 0), (0, math.nan), (0.5, 0), (-2, 0), (0, -1), (math.inf, 0), (0, 1e30)]
)
def test_start_at_an_invalid_item_is_refused(rig, values):
    store_mission(rig)
    assert results(rig.command(MISSION_START, *values)) == [DENIED]
    assert rig.request_handler.intents == []


def test_start_is_refused_without_a_mission_or_by_the_mode(rig, texts):
    replies = rig.command(MISSION_START)
    assert (results(replies), texts(replies)) == ([DENIED], ["MISSION_START: there is no mission"])
    store_mission(rig)
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "AUTO refused: no position")
    assert results(rig.command(MISSION_START, 3)) == [TEMPORARILY_REJECTED]
    assert rig.request_handler.intents == [SetMode(AUTO)]


@pytest.mark.parametrize(
    ("values", "intent"),
    [
        *(((number, 0), SetMissionItem(index)) for number, index in ((3, 2), (0, 0), (5, 4))),
        *(((number, 1), SetMissionItem(index, restart=True)) for number, index in ((1, 0), (-1, 2))),
    ],
)
def test_mission_continues_with_the_requested_item(rig, values, intent):
    store_mission(rig)
    assert results(rig.command(SET_CURRENT_ITEM, *values)) == [ACCEPTED]
    assert rig.request_handler.intents == [intent]


@pytest.mark.parametrize(
    ("values", "result"),
    [((6, 0), FAILED), ((-2, 0), FAILED), ((math.nan, 0), FAILED), ((1.5, 0), FAILED), ((1, math.nan), DENIED)],
)
def test_invalid_item_is_refused(rig, values, result):
    assert results(rig.command(SET_CURRENT_ITEM, 1, 0)) == [FAILED]  # no mission
    store_mission(rig)
    assert results(rig.command(SET_CURRENT_ITEM, *values)) == [result]
    assert rig.request_handler.intents == []


def test_current_item_before_the_first_tick_is_the_first(make_rig):
    rig = make_rig()
    rig.request_handler.stored_plans = rig.request_handler.stored_plans.replaced(PLAN)
    assert results(rig.command(SET_CURRENT_ITEM, -1)) == [ACCEPTED]
    rig.tick(mission=MissionReport(MissionState.NOT_STARTED, None, 5))
    assert results(rig.command(SET_CURRENT_ITEM, -1, 1)) == [ACCEPTED]
    assert rig.request_handler.intents == [SetMissionItem(0), SetMissionItem(0, restart=True)]


def test_first_item_of_a_generic_autopilot_has_number_zero(make_rig):
    rig = make_rig(identity=0)
    store_mission(rig)
    rig.command(SET_CURRENT_ITEM, 3)
    assert rig.request_handler.intents == [SetMissionItem(3)]


def test_speed_is_validated_and_ignored(rig, texts):
    replies = rig.command(CHANGE_SPEED, 1.0, 0.5)
    assert results(replies) == [ACCEPTED]
    assert texts(replies) == ["Speed command ignored: a wave glider cannot set its speed"]
    for values in ((2.0, 0.5), (1.0, math.nan)):
        assert results(rig.command(CHANGE_SPEED, *values)) == [DENIED]
    assert rig.request_handler.intents == []
