"""Home, mission and fence by command."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SetMissionItem, SetMode, Verdict
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.reports import Home, MissionReport, MissionState
from firmware_py.link.commands.steering import home_request, position_goal
from support.link import results

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
PLAN = Plan.of(PlanKind.MISSION, [PlanItem(16, 6, x=index, y=1) for index in range(5)])


def with_mission(rig, *, reported=True):
    """Put a mission of five items in force; what the last tick says of it may be older."""
    rig.request_handler.plans_kept = rig.request_handler.plans_kept.replaced(PLAN)
    rig.tick(mission=MissionReport(MissionState.ACTIVE, 2, 5) if reported else MissionReport())


@pytest.mark.parametrize(("number", "limit"), [(0, 90.0), (1, 180.0), (2, 1e4)])
def test_a_place_may_be_at_its_limits_and_not_beyond(number, limit):
    assert home_request(45.0, 9.0, math.nan).altitude_m == 0.0
    for value, is_place in ((limit, True), (-limit, True), (1.0001 * limit, False), (-1.0001 * limit, False)):
        place = [45.0, 9.0, 2.0]
        place[number] = value
        replies = [home_request(*place), *([position_goal(*place[:2])] if number < 2 else [])]
        assert {isinstance(one, str) for one in replies} == {not is_place}


def test_the_old_message_sets_home_and_says_so(rig, of, texts):
    place = (450_000_000, -1_200_000_000, 2_000)
    rig.tell(mavlink.MAVLink_set_home_position_message(1, *place, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0))
    (home,) = rig.request_handler.intents
    assert (home.latitude_rad, home.altitude_m) == pytest.approx((math.radians(45), 2.0))
    replies = rig.tick(home=Home(home.latitude_rad, home.longitude_rad, 2.0))
    assert len(of(replies, "HOME_POSITION")) == len(of(replies, "GPS_GLOBAL_ORIGIN")) == 1
    assert of(replies, "GPS_GLOBAL_ORIGIN")[0].latitude == 450_000_000
    replies = rig.tell(mavlink.MAVLink_set_home_position_message(1, 0, 0, 0, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0))
    assert texts(replies) == ["SET_HOME_POSITION: home at 0, 0 is not accepted"]
    assert len(rig.request_handler.intents) == 1


def test_home_set_to_where_it_was_is_reported_too_and_once(rig, of):
    where = {"home": Home(0.5, 0.2, 0.0)}
    assert len(of(rig.tick(**where), "HOME_POSITION")) == 1
    assert of(rig.tick(**where), "HOME_POSITION") == []
    assert results(rig.command(179, 1)) == [ACCEPTED]
    assert len(of(rig.tick(**where), "HOME_POSITION")) == 1
    assert of(rig.tick(**where), "HOME_POSITION") == []


@pytest.mark.parametrize(
    ("first", "last", "intents"),
    [
        (0, 0, [SetMode(10)]),
        (1, 0, [SetMode(10), SetMissionItem(0)]),
        (4, 5, [SetMode(10), SetMissionItem(3)]),
    ],
)
def test_a_mission_starts_at_the_item_that_the_stations_number_names(rig, first, last, intents):
    with_mission(rig)
    assert results(rig.command(300, first, last)) == [ACCEPTED]
    assert rig.request_handler.intents == intents


def test_a_mission_starts_as_soon_as_it_is_there(rig):
    """MAVSDK names the last item at once after the upload, before a tick has reported of it."""
    with_mission(rig, reported=False)
    assert results(rig.command(300, 0, 5)) == [ACCEPTED]


@pytest.mark.parametrize(
    "values", [(6, 0), (0, 3), (math.nan, 0), (0, math.nan), (0.5, 0), (-2, 0), (0, -1), (math.inf, 0), (0, 1e30)]
)
def test_a_start_that_cannot_be_changes_nothing(rig, values):
    with_mission(rig)
    assert results(rig.command(300, *values)) == [DENIED]
    assert rig.request_handler.intents == []


def test_without_a_mission_nothing_starts_and_a_refused_mode_leaves_the_item(rig, texts):
    replies = rig.command(300)
    assert (results(replies), texts(replies)) == ([DENIED], ["MISSION_START: there is no mission"])
    with_mission(rig)
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "AUTO refused: no position")
    assert results(rig.command(300, 3)) == [REJECTED]
    assert rig.request_handler.intents == [SetMode(10)]


@pytest.mark.parametrize(
    ("values", "intent"),
    [
        ((3, 0), SetMissionItem(2)),
        ((1, 1), SetMissionItem(0, restart=True)),
        ((0, 0), SetMissionItem(0)),
        ((5, 0), SetMissionItem(4)),
        ((-1, 1), SetMissionItem(2, restart=True)),
    ],
)
def test_another_item(rig, values, intent):
    with_mission(rig)
    assert results(rig.command(224, *values)) == [ACCEPTED]
    assert rig.request_handler.intents == [intent]


@pytest.mark.parametrize(
    ("values", "result"),
    [((6, 0), FAILED), ((-2, 0), FAILED), ((math.nan, 0), FAILED), ((1.5, 0), FAILED), ((1, math.nan), DENIED)],
)
def test_an_item_that_is_not_there_changes_nothing(rig, values, result):
    assert results(rig.command(224, 1, 0)) == [FAILED]  # no mission
    with_mission(rig)
    assert results(rig.command(224, *values)) == [result]
    assert rig.request_handler.intents == []


def test_without_ardupilots_identity_the_first_item_is_number_zero(make_rig):
    rig = make_rig()
    rig.endpoint._context.autopilot = 0
    with_mission(rig)
    rig.command(224, 3)
    assert rig.request_handler.intents == [SetMissionItem(3)]


def test_a_speed_is_answered_as_in_a_mission_and_changes_nothing(rig, of, texts):
    replies = rig.command(178, 1.0, 0.5)
    assert (of(replies, "COMMAND_ACK")[0].result, texts(replies)) == (
        0,
        ["Speed command ignored: a wave glider cannot set its speed"],
    )
    replies = rig.command(178, 2.0, 0.5)
    assert of(replies, "COMMAND_ACK")[0].result == 2
    assert rig.command(178, 1.0, float("nan"))[0].result == 2
    assert rig.request_handler.intents == []
