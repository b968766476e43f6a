"""Maintenance commands: rudder test, calibration, storage; and commands with progress messages."""

import math

import msgspec
import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, BenchRudder, ForgetParameters, SetParameter, Verdict
from firmware_py.common.records import Calibration, CalibrationState, RudderFeedback
from firmware_py.link.commands.server import CommandRow, PendingCommand
from support.link import results

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)  # MAV_RESULT
CALIBRATE, STORE = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, mavlink.MAV_CMD_PREFLIGHT_STORAGE
ALIGN_COMPASS, START_SWING = 42006, 42424  # FIXED_MAG_CAL_YAW, DO_START_MAG_CAL of ArduPilot
COMMAND_CANCEL = 80  # message id
BENCH = {"armed": False, "servo": RudderFeedback(0.0, 0.1)}


def test_present_rudder_angle_becomes_amidships(rig, texts):
    rig.tick(**BENCH)
    replies = rig.command(CALIBRATE, 0, 0, 0, 2)
    assert results(replies) == [ACCEPTED]
    assert texts(replies) == ["RUD_CENTRE_DEG is now 5.73"]
    centre, bench = rig.request_handler.intents
    assert bench == BenchRudder(0.0, 0.0)
    assert centre == SetParameter("RUD_CENTRE_DEG", pytest.approx(5.7296, abs=1e-4))


@pytest.mark.parametrize(
    "changes",
    [{"armed": True}, {"armed": False}, {**BENCH, "rudder_ok": False}, {**BENCH, "servo": RudderFeedback(0.0)}],
)
def test_rudder_centre_is_refused_armed_or_without_an_angle(rig, changes):
    rig.tick(**{**BENCH, "servo": None, **changes})
    assert results(rig.command(CALIBRATE, 0, 0, 0, 2)) == [REJECTED]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    "values", [(1,), (0, 76), (0, 0, 1), (0, 0, 0, 1), (0, 0, 0, 2, 1), (0, math.inf), (0, 0, 0, 0, 0, 0, 3)]
)
def test_other_calibrations_are_refused_with_a_remedy(rig, texts, values):
    rig.tick(**BENCH)
    replies = rig.command(CALIBRATE, *values)
    assert results(replies) == [UNSUPPORTED]
    assert "FIXED_MAG_CAL_YAW" in texts(replies)[0]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize("has_compass", [True, False])
@pytest.mark.parametrize("command", [(CALIBRATE, 0, 0, 0, 2), (CALIBRATE, 0, 1), (ALIGN_COMPASS, 10), (START_SWING, 1)])
def test_calibration_is_refused_before_the_first_tick(make_rig, command, has_compass):
    rig = make_rig()
    if has_compass:
        add_compass(rig)
    assert results(rig.command(*command)) == [REJECTED]


def test_calibration_of_nothing_is_accepted(rig):
    assert results(rig.command(CALIBRATE)) == results(rig.command(CALIBRATE, math.nan, math.nan)) == [ACCEPTED]


@pytest.mark.parametrize(
    ("yaw_deg", "offset_deg"),
    [(57.29578, 5.0), (60.0, 7.70422), (-180.0, 127.70422), (360.0, -52.29578), (-360.0, -52.29578)],
)
def test_compass_is_aligned_to_a_known_heading(rig, yaw_deg, offset_deg):
    rig.request_handler.values = rig.request_handler.values.replaced("CMP_OFFSET_DEG", 5.0)
    rig.tick(armed=False, heading_rad=1.0)
    assert results(rig.command(ALIGN_COMPASS, yaw_deg, 0, 0, 0)) == [ACCEPTED]
    assert rig.request_handler.values["CMP_OFFSET_DEG"] == pytest.approx(offset_deg, abs=1e-4)


@pytest.mark.parametrize(
    ("values", "changes", "result"),
    [
        ((math.nan,), {}, DENIED), ((361,), {}, DENIED), ((-361,), {}, DENIED),
        ((10, 2), {}, DENIED), ((10, math.inf), {}, DENIED),
        ((10,), {"armed": True}, REJECTED), ((10,), {"heading_ok": False}, REJECTED),
        ((10,), {"heading_rad": None}, REJECTED),
    ],
)  # fmt: skip
def test_alignment_is_refused_for_invalid_values_or_state(rig, values, changes, result):
    rig.tick(**{"armed": False, **changes})
    assert results(rig.command(ALIGN_COMPASS, *values)) == [result]
    assert rig.request_handler.intents == []


def test_storage_is_acknowledged_after_storing(rig, texts):
    assert results(rig.command(STORE, 0)) == results(rig.command(STORE, 0, 1)) == [ACCEPTED]
    rig.request_handler.at_once = False
    assert results(rig.command(STORE, 1)) == []
    rig.request_handler.waiting.pop()(True)
    replies = rig.replies()
    assert (results(replies), texts(replies)) == ([ACCEPTED], ["All settings stored"])
    rig.command(STORE, 1)
    rig.request_handler.waiting.pop()(False)
    assert results(rig.replies()) == [FAILED]


def test_reset_of_the_parameters_takes_effect_at_the_next_start(rig, texts):
    replies = rig.command(STORE, 2, -1)
    assert results(replies) == [ACCEPTED]
    assert "at the next start" in texts(replies)[0]
    assert rig.request_handler.intents == [ForgetParameters()]
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "armed")
    assert results(rig.command(STORE, 2)) == [REJECTED]


@pytest.mark.parametrize(
    ("values", "result"),
    [((3,), DENIED), ((math.nan,), DENIED), ((-1,), DENIED), ((0, 2), UNSUPPORTED), ((0, -2), UNSUPPORTED)],
)
def test_invalid_storage_values_are_refused(rig, values, result):
    assert results(rig.command(STORE, *values)) == [result]
    assert rig.request_handler.intents == []


# ---------------------------------------------------------------------- long commands


def test_long_command_sends_progress_until_its_end(rig):
    rig.request_handler.at_once = False
    assert results(rig.command(STORE, 1)) == []
    replies = rig.ticks(25)
    assert results(replies) == [IN_PROGRESS] * 3
    assert {ack.progress for ack in replies if ack.get_type() == "COMMAND_ACK"} == {255}
    assert results(rig.command(STORE, 1, confirmation=1)) == [IN_PROGRESS]  # a retry
    assert results(rig.command(STORE, 1)) == [REJECTED]  # a new command
    rig.request_handler.waiting.pop(0)(True)
    assert results(rig.replies()) == [ACCEPTED]
    assert results(rig.ticks(30)) == []


def test_storage_has_no_timeout(rig, texts):
    """A disk that hangs may still store the parameters."""
    rig.request_handler.at_once = False
    rig.command(STORE, 1)
    replies = [*rig.tick(seconds=31.0), *rig.tick(seconds=3600.0)]
    assert results(replies) == [IN_PROGRESS] * 2
    assert results(rig.command(STORE, 1, confirmation=1)) == [REJECTED]  # long after the first: a new command
    (finish_storing,) = rig.request_handler.waiting
    finish_storing(True)
    replies = rig.replies()
    assert (results(replies), texts(replies)[-1]) == ([ACCEPTED], "All settings stored")
    assert results(rig.ticks(30)) == []


def test_long_command_fails_once_after_its_timeout(rig, compass, texts):
    rig.command(CALIBRATE, 0, 1)
    replies = rig.tick(seconds=901.0, **BENCH)
    assert (results(replies), texts(replies)[-1]) == ([FAILED], "PREFLIGHT_CALIBRATION: not done in time")
    assert results(rig.ticks(30)) == []


def test_number_of_long_commands_is_limited_to_eight(rig, texts):
    server = rig.endpoint._handlers[mavlink.MAVLINK_MSG_ID_COMMAND_LONG].__self__
    server._rows = {n: CommandRow(n, "LONG", lambda *_: PendingCommand(timeout_s=60.0), "") for n in range(1, 10)}
    assert [results(rig.command(number)) for number in range(1, 9)] == [[]] * 8
    replies = rig.command(9)
    assert (results(replies), texts(replies)) == ([REJECTED], ["Too many commands in progress"])


def test_failure_of_the_disk_is_reported(rig, texts):
    rig.request_handler.at_once = False
    text_of_command = {
        (CALIBRATE, 0, 0, 0, 2): "PREFLIGHT_CALIBRATION: RUD_CENTRE_DEG active but not stored",
        (STORE, 1): "PREFLIGHT_STORAGE: not all stored; retrying",
        (STORE, 2): "PREFLIGHT_STORAGE: not stored, parameters unchanged",
    }
    rig.tick(**BENCH)
    for (number, *values), text in text_of_command.items():
        rig.command(number, *values)
        rig.request_handler.waiting.pop()(False)
        replies = rig.replies()
        assert (results(replies), texts(replies)) == ([FAILED], [text])


def test_cancel_of_storage_has_no_effect(rig):
    rig.request_handler.at_once = False
    rig.command(STORE, 1)
    assert rig.send(cancel_message(STORE)) == []
    rig.request_handler.waiting.pop()(True)
    assert results(rig.replies()) == [ACCEPTED]


def cancel_message(command):
    return mavlink.mavlink_map[COMMAND_CANCEL](1, 1, command)


def test_pending_command_reports_progress_and_is_cancelled_once():
    calls = []
    pending = PendingCommand(timeout_s=10.0, percent=lambda: 40, cancel=lambda: calls.append("cancelled"))
    pending.begin(0.0, calls.append)
    times_s = (0.29, 0.3, 0.31, 1.29, 1.3, 1.31)
    assert [pending.is_progress_due(now_s) for now_s in times_s] == [False, True, False, False, True, False]
    assert [pending.has_timed_out(now_s) for now_s in (10.0, 10.01)] == [False, True]
    assert pending.percent() == 40
    assert pending.cancel()
    pending.finish(Answer(Verdict.ACCEPTED))
    assert calls == ["cancelled"]
    assert not pending.cancel()


def test_retry_does_not_set_the_parameter_again(rig):
    rig.tick(armed=False)
    rig.command(ALIGN_COMPASS, 60)
    rig.command(ALIGN_COMPASS, 60, confirmation=1)
    assert [type(intent) for intent in rig.request_handler.intents] == [SetParameter]


# ---------------------------------------------------------------------- compass with its own calibration


class FakeCompass:
    """A compass with its own calibration; the test sets its state."""

    def __init__(self):
        self.state = Calibration()
        self.is_present = True
        self.cancel_count = 0

    def calibrate(self, now_s):
        self.state = Calibration(CalibrationState.RUNNING, 25)
        return self.is_present

    def calibration(self):
        return self.state

    def cancel(self):
        self.cancel_count += 1
        self.state = Calibration()


def add_compass(rig):
    fake = FakeCompass()
    rig.endpoint._context.suppliers = msgspec.structs.replace(rig.endpoint._context.suppliers, calibrator=fake)
    return fake


@pytest.fixture
def compass(rig):
    fake = add_compass(rig)
    rig.tick(armed=False)
    return fake


def test_compass_calibration_reports_its_progress_and_end(rig, compass, texts):
    assert texts(rig.command(CALIBRATE, 0, 1)) == ["Compass calibration: turn a full circle by hand, ashore"]
    acks = [message for message in rig.ticks(10) if message.get_type() == "COMMAND_ACK"]
    assert [(ack.result, ack.progress) for ack in acks] == [(IN_PROGRESS, 25)]
    compass.state = Calibration(CalibrationState.DONE, 100, "Compass calibrated")
    replies = rig.tick()
    assert (results(replies), texts(replies)) == ([ACCEPTED], ["Compass calibrated"])
    assert results(rig.ticks(20)) == []


@pytest.mark.parametrize(
    ("end", "text"),
    [(Calibration(CalibrationState.FAILED, 100, "score 9"), "score 9"), (Calibration(), "Compass calibration aborted")],
)
def test_failed_compass_calibration_reports_the_reason(rig, compass, texts, end, text):
    rig.command(CALIBRATE, 0, 1)
    compass.state = end
    replies = rig.tick()
    assert (results(replies), texts(replies)) == ([FAILED], [text])


def test_compass_calibration_is_cancelled_by_command_or_timeout(rig, compass):
    rig.command(CALIBRATE, 0, 1)
    assert results(rig.send(cancel_message(CALIBRATE))) == [CANCELLED]
    assert compass.cancel_count == 1
    assert rig.send(cancel_message(CALIBRATE)) == []
    assert results([message for _ in range(20) for message in rig.tick(armed=False)]) == []
    rig.command(CALIBRATE, 0, 1)
    assert results(rig.tick(seconds=901.0)) == [FAILED]
    assert compass.cancel_count == 2
    assert results(rig.ticks(20)) == []


def test_compass_calibration_is_refused_armed_or_without_compass(rig, compass):
    compass.is_present = False
    assert results(rig.command(CALIBRATE, 0, 1)) == [REJECTED]
    rig.tick(armed=True)
    assert results(rig.command(CALIBRATE, 0, 1)) == [REJECTED]
