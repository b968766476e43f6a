"""Compass swing by command, as QGroundControl, Mission Planner and MAVProxy start, accept and cancel it."""

import copy
import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState
from firmware_py.common.reports import SwingReport
from firmware_py.estimate.deviation import NAMES
from firmware_py.link.telemetry.status import swing_report_message
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


SWINGS = []  # cache: the first completed swing


@pytest.fixture
def proposed(under_way):
    """A rig with a proposal; the present B is 2 deg."""
    rig, values = under_way, ParameterSet().replaced("CMP_DEV_B", 2.0)
    rig.request_handler.values = values
    assert results(rig.command(START)) == [ACCEPTED]
    if not SWINGS:
        for tick in voyage(legs=20):
            list(rig.request_handler.compass_swing.take(tick.inputs, values))
        SWINGS.append(copy.deepcopy(rig.request_handler.compass_swing))
    rig.request_handler.compass_swing = copy.deepcopy(SWINGS[0])
    assert rig.request_handler.compass_swing.report.state is CalibrationState.DONE
    return rig


@pytest.mark.parametrize("values", STATIONS.values(), ids=STATIONS)
def test_swing_is_started_by_every_station_and_sets_nothing(under_way, texts, values):
    replies = under_way.command(START, *values)
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
def test_swing_without_heading_or_position_or_disarmed_is_refused(rig, texts, changes, reason, command):
    rig.tick(**{**UNDER_WAY, **changes})
    replies = rig.command(*command)
    assert (results(replies), texts(replies)) == ([REJECTED], [f"Compass swing refused: {reason}"])
    assert not rig.request_handler.compass_swing.is_running


def test_second_start_is_refused(under_way, texts):
    under_way.command(START)
    replies = under_way.command(START, 1)
    assert results(replies) == [REJECTED]
    assert "already in progress" in texts(replies)[0]


@pytest.mark.parametrize("command", [START, ACCEPT, CANCEL])
@pytest.mark.parametrize("mask", [2, -1, math.inf, 255])
def test_mask_of_another_compass_is_refused(under_way, command, mask):
    assert results(under_way.command(command, mask)) == [DENIED]
    assert not under_way.request_handler.compass_swing.is_running


def test_progress_is_sent_without_a_request(under_way):
    under_way.command(START)
    swing = under_way.request_handler.compass_swing
    for tick in voyage(legs=3):
        list(swing.take(tick.inputs, under_way.request_handler.values))
    reports = of_type([message for _ in range(60) for message in under_way.tick()], "MAG_CAL_PROGRESS")
    assert {(report.compass_id, report.cal_mask, report.cal_status) for report in reports} == {(0, 1, 2)}
    assert {report.completion_pct for report in reports} == {swing.report.percent}
    assert int.from_bytes(bytes(reports[0].completion_mask), "little") == swing.report.sectors > 0


def test_proposal_is_set_when_it_is_accepted(proposed, texts):
    reports = of_type([message for _ in range(60) for message in proposed.tick(**UNDER_WAY)], "MAG_CAL_REPORT")
    assert {(report.cal_status, report.autosaved) for report in reports} == {(4, 0)}
    assert deviation(proposed) == [0.0, 2.0, 0.0, 0.0, 0.0]
    replies = proposed.command(ACCEPT, 1)
    assert results(replies) == [ACCEPTED]
    assert [report.autosaved for report in of_type(replies, "MAG_CAL_REPORT")] == [1]
    assert texts(replies)[-1].endswith("deg set")
    assert deviation(proposed)[0] == pytest.approx(5.0, abs=0.3)
    assert deviation(proposed)[1] == pytest.approx(0.0, abs=0.5)
    assert not proposed.request_handler.compass_swing.is_running


def test_accepted_proposal_is_acknowledged_after_storing(proposed):
    proposed.request_handler.at_once = False
    assert results(proposed.command(ACCEPT)) == []
    proposed.request_handler.waiting.pop()(True)
    assert results(proposed.replies()) == [ACCEPTED]


def test_cancel_after_accept_restores_the_former_values(proposed, texts):
    proposed.command(ACCEPT)
    replies = proposed.command(CANCEL)
    assert results(replies) == [ACCEPTED]
    assert texts(replies)[-1].endswith("deg restored")
    assert deviation(proposed) == [0.0, 2.0, 0.0, 0.0, 0.0]
    intents = list(proposed.request_handler.intents)
    assert results(proposed.command(CANCEL, 1)) == [ACCEPTED]  # nothing is left to restore
    assert proposed.request_handler.intents == intents


def test_cancel_discards_a_proposal(proposed, texts):
    assert texts(proposed.command(CANCEL)) == ["Compass swing: cancelled, nothing was set"]
    assert proposed.request_handler.intents == []
    replies = proposed.command(ACCEPT)
    assert (results(replies), texts(replies)) == ([REJECTED], ["Compass swing: nothing to accept, 0 % done"])


def test_cancel_without_a_swing_is_accepted(under_way, texts):
    replies = under_way.command(CANCEL)
    assert (results(replies), texts(replies)) == ([ACCEPTED], [])


def test_proposal_out_of_range_sets_nothing(proposed, texts):
    swing = proposed.request_handler.compass_swing
    swing._report = type(swing.report)(CalibrationState.DONE, 100, estimated_rad=(0.1, 0.1, 0.1, 0.1, 2.0))
    replies = proposed.command(ACCEPT)
    assert results(replies) == [DENIED]
    assert "CMP_DEV_E" in texts(replies)[0]
    assert proposed.request_handler.intents == []


def test_preflight_calibration_starts_a_swing_without_own_calibration(under_way):
    assert results(under_way.command(241, 0, 1)) == [ACCEPTED]
    assert under_way.request_handler.compass_swing.is_running


@pytest.mark.parametrize(
    ("values", "fitness_deg"),
    [({"sd_rad": 0.01, "residual_after_rad": 0.02}, 0.02), ({"sd_rad": 0.01}, 0.01), ({}, 0.0)],
)
def test_fitness_is_the_residual_or_the_standard_deviation(values, fitness_deg):
    report = swing_report_message(SwingReport(CalibrationState.DONE, **values), is_saved=True)
    assert (report.fitness, report.autosaved) == (pytest.approx(math.degrees(fitness_deg)), 1)
