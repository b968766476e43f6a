"""A swing of the compass from the wire: as QGroundControl, Mission Planner and MAVProxy begin, accept and cancel it."""

import copy
import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState
from firmware_py.estimate.deviation import NAMES
from support.link import of_type, results
from support.swing import voyage

START, ACCEPT, CANCEL = 42424, 42425, 42426
ACCEPTED, REJECTED, DENIED = range(3)
UNDER_WAY = {"armed": True, "heading_ok": True, "position_ok": True}
# mask, retry, autosave, delay, autoreboot
STATIONS = {"QGroundControl": (1, 0, 1, 0, 0), "Mission Planner": (0, 1, 1), "MAVProxy": (0, 0, 1)}


def deviation(rig):
    return [rig.request_handler.values[name] for name in NAMES]


@pytest.fixture
def under_way(rig):
    rig.tick(**UNDER_WAY)
    return rig


SWUNG = []  # the first swing that a test has made


@pytest.fixture
def proposed(under_way):
    """A rig with a proposal, before 2 deg of B in force."""
    rig, values = under_way, ParameterSet().replaced("CMP_DEV_B", 2.0)
    rig.request_handler.values = values
    assert results(rig.command(START)) == [ACCEPTED]
    if not SWUNG:
        for tick in voyage(legs=20):
            list(rig.request_handler.compass_swing.take(tick.inputs, values))
        SWUNG.append(copy.deepcopy(rig.request_handler.compass_swing))
    rig.request_handler.compass_swing = copy.deepcopy(SWUNG[0])
    assert rig.request_handler.compass_swing.report.state is CalibrationState.DONE
    return rig


@pytest.mark.parametrize("query", STATIONS.values(), ids=STATIONS)
def test_each_station_begins_a_swing_that_sets_nothing(under_way, texts, query):
    replies = under_way.command(START, *query)
    assert results(replies) == [ACCEPTED]
    assert texts(replies)[0].endswith("then accept")
    assert under_way.request_handler.compass_swing.is_running
    assert under_way.request_handler.intents == []


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"armed": False}, "disarmed"),
        ({"heading_ok": False}, "no valid heading"),
        ({"position_ok": False}, "no position"),
    ],
)
@pytest.mark.parametrize("command", [(START,), (241, 0, 1)])
def test_a_swing_that_could_see_nothing_is_refused(rig, texts, changes, reason, command):
    rig.tick(**{**UNDER_WAY, **changes})
    replies = rig.command(*command)
    assert (results(replies), texts(replies)) == ([REJECTED], [f"Compass swing refused: {reason}"])
    assert not rig.request_handler.compass_swing.is_running


def test_a_second_start_does_not_forget_the_first(under_way, texts):
    under_way.command(START)
    replies = under_way.command(START, 1)
    assert results(replies) == [REJECTED]
    assert "under way" in texts(replies)[0]


@pytest.mark.parametrize("command", [START, ACCEPT, CANCEL])
@pytest.mark.parametrize(("mask", "result"), [(2, DENIED), (-1, DENIED), (math.inf, DENIED), (255, DENIED)])
def test_there_is_one_compass(under_way, command, mask, result):
    assert results(under_way.command(command, mask)) == [result]
    assert not under_way.request_handler.compass_swing.is_running


def test_the_progress_is_sent_without_being_asked_for(under_way):
    under_way.command(START)
    swing = under_way.request_handler.compass_swing
    for tick in voyage(legs=3):
        list(swing.take(tick.inputs, under_way.request_handler.values))
    reports = of_type([message for _ in range(60) for message in under_way.tick()], "MAG_CAL_PROGRESS")
    assert {(one.compass_id, one.cal_mask, one.cal_status) for one in reports} == {(0, 1, 2)}
    assert {one.completion_pct for one in reports} == {swing.report.percent}
    assert int.from_bytes(bytes(reports[0].completion_mask), "little") == swing.report.sectors > 0


def test_what_is_proposed_waits_and_is_taken_whole_when_it_is_accepted(proposed, texts):
    reports = of_type([message for _ in range(60) for message in proposed.tick(**UNDER_WAY)], "MAG_CAL_REPORT")
    assert {(one.cal_status, one.autosaved) for one in reports} == {(4, 0)}
    assert deviation(proposed) == [0.0, 2.0, 0.0, 0.0, 0.0]
    replies = proposed.command(ACCEPT, 1)
    assert results(replies) == [ACCEPTED]
    assert [one.autosaved for one in of_type(replies, "MAG_CAL_REPORT")] == [1]
    assert texts(replies)[-1].endswith("deg is in force")
    assert deviation(proposed)[0] == pytest.approx(5.0, abs=0.3)
    assert deviation(proposed)[1] == pytest.approx(0.0, abs=0.5)
    assert not proposed.request_handler.compass_swing.is_running


def test_an_accepted_proposal_is_acknowledged_when_it_is_on_disk(proposed):
    proposed.request_handler.at_once = False
    assert results(proposed.command(ACCEPT)) == []
    proposed.request_handler.waiting.pop()(True)
    assert results(proposed.replies()) == [ACCEPTED]


def test_cancel_after_accept_puts_back_what_was_in_force(proposed, texts):
    proposed.command(ACCEPT)
    replies = proposed.command(CANCEL)
    assert results(replies) == [ACCEPTED]
    assert texts(replies)[-1].endswith("deg is taken back")
    assert deviation(proposed) == [0.0, 2.0, 0.0, 0.0, 0.0]
    query = len(proposed.request_handler.intents)
    assert results(proposed.command(CANCEL, 1)) == [ACCEPTED]  # there is no more to be taken back
    assert len(proposed.request_handler.intents) == query


def test_cancel_drops_a_proposal_and_sets_nothing(proposed, texts):
    assert texts(proposed.command(CANCEL)) == ["Compass swing: cancelled, nothing was set"]
    assert proposed.request_handler.intents == []
    replies = proposed.command(ACCEPT)
    assert (results(replies), texts(replies)) == ([REJECTED], ["Compass swing: nothing to accept, 0 % done"])


def test_cancel_without_a_swing_says_that_swings_are_known_here(under_way, texts):
    replies = under_way.command(CANCEL)
    assert (results(replies), texts(replies)) == ([ACCEPTED], [])


def test_a_proposal_out_of_range_sets_nothing_at_all(proposed, texts):
    swing = proposed.request_handler.compass_swing
    swing._report = type(swing.report)(CalibrationState.DONE, 100, estimated_rad=(0.1, 0.1, 0.1, 0.1, 2.0))
    replies = proposed.command(ACCEPT)
    assert results(replies) == [DENIED]
    assert "CMP_DEV_E" in texts(replies)[0]
    assert proposed.request_handler.intents == []


def test_any_compass_without_a_calibration_of_its_own_is_swung_by_preflight_calibration(under_way):
    assert results(under_way.command(241, 0, 1)) == [ACCEPTED]
    assert under_way.request_handler.compass_swing.is_running
