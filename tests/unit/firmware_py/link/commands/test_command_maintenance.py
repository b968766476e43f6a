"""The commands of the workshop: rudder on the bench, calibration, storage; and commands that take a while."""

import math

import msgspec
import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, BenchRudder, ForgetParameters, SetParameter, Verdict
from firmware_py.common.records import Calibration, CalibrationState, RudderFeedback
from firmware_py.link.commands.server import PendingCommand
from support.link import results

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
BENCH = {"armed": False, "servo": RudderFeedback(0.0, 0.1)}


def test_the_rudder_as_it_stands_becomes_amidships(rig, texts):
    rig.tick(**BENCH)
    replies = rig.command(241, 0, 0, 0, 2)
    assert results(replies) == [ACCEPTED]
    assert texts(replies) == ["RUD_CENTRE_DEG is now 5.73"]
    centre, bench = rig.request_handler.intents
    assert (bench, centre.name, centre.value) == (
        BenchRudder(0.0, 0.0),
        "RUD_CENTRE_DEG",
        pytest.approx(5.7296, abs=1e-4),
    )


@pytest.mark.parametrize(
    "changes",
    [{"armed": True}, {"armed": False}, {**BENCH, "rudder_ok": False}, {**BENCH, "servo": RudderFeedback(0.0)}],
)
def test_no_centre_while_armed_or_without_an_angle(rig, changes):
    rig.tick(**{**BENCH, "servo": None, **changes})
    assert results(rig.command(241, 0, 0, 0, 2)) == [REJECTED]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    "values", [(1,), (0, 76), (0, 0, 1), (0, 0, 0, 1), (0, 0, 0, 2, 1), (0, math.inf), (0, 0, 0, 0, 0, 0, 3)]
)
def test_other_calibrations_are_unsupported_and_say_what_to_do_instead(rig, texts, values):
    rig.tick(**BENCH)
    replies = rig.command(241, *values)
    assert results(replies) == [UNSUPPORTED]
    assert "FIXED_MAG_CAL_YAW" in texts(replies)[0]
    assert rig.request_handler.intents == []


def test_nothing_to_calibrate_is_nothing_to_do(rig):
    assert results(rig.command(241)) == results(rig.command(241, math.nan, math.nan)) == [ACCEPTED]


@pytest.mark.parametrize(("yaw_deg", "offset_deg"), [(57.29578, 5.0), (60.0, 7.70422), (-180.0, 127.70422)])
def test_the_compass_is_aligned_to_a_known_heading(rig, yaw_deg, offset_deg):
    rig.request_handler.values = rig.request_handler.values.replaced("CMP_OFFSET_DEG", 5.0)
    rig.tick(armed=False, heading_rad=1.0)
    assert results(rig.command(42006, yaw_deg, 0, 0, 0)) == [ACCEPTED]
    assert rig.request_handler.values["CMP_OFFSET_DEG"] == pytest.approx(offset_deg, abs=1e-4)


@pytest.mark.parametrize(
    ("values", "changes", "result"),
    [
        ((math.nan,), {}, DENIED), ((361,), {}, DENIED), ((10, 2), {}, DENIED), ((10, math.inf), {}, DENIED),
        ((10,), {"armed": True}, REJECTED), ((10,), {"heading_ok": False}, REJECTED),
        ((10,), {"heading_rad": None}, REJECTED),
    ],
)  # fmt: skip
def test_a_compass_that_cannot_be_aligned_stays(rig, values, changes, result):
    rig.tick(**{"armed": False, **changes})
    assert results(rig.command(42006, *values)) == [result]
    assert rig.request_handler.intents == []


def test_storage_is_acknowledged_when_it_is_on_disk(rig, texts):
    assert results(rig.command(245, 0)) == [ACCEPTED]
    rig.request_handler.at_once = False
    assert results(rig.command(245, 1)) == []
    rig.request_handler.waiting.pop()(True)
    replies = rig.replies()
    assert (results(replies), texts(replies)) == ([ACCEPTED], ["All settings stored"])
    rig.command(245, 1)
    rig.request_handler.waiting.pop()(False)
    assert results(rig.replies()) == [FAILED]


def test_reset_forgets_what_links_have_set(rig, texts):
    replies = rig.command(245, 2, -1)
    assert results(replies) == [ACCEPTED]
    assert "at the next start" in texts(replies)[0]
    assert rig.request_handler.intents == [ForgetParameters()]
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "armed")
    assert results(rig.command(245, 2)) == [REJECTED]


@pytest.mark.parametrize(
    ("values", "result"), [((3,), DENIED), ((math.nan,), DENIED), ((-1,), DENIED), ((0, 2), UNSUPPORTED)]
)
def test_other_storage_is_refused(rig, values, result):
    assert results(rig.command(245, *values)) == [result]
    assert rig.request_handler.intents == []


# ------------------------------------------------------------------ commands that take a while


def test_a_command_under_way_says_so_until_it_ends(rig):
    rig.request_handler.at_once = False
    assert results(rig.command(245, 1)) == []
    replies = rig.ticks(25)
    assert results(replies) == [IN_PROGRESS] * 3
    assert {ack.progress for ack in replies if ack.get_type() == "COMMAND_ACK"} == {255}
    assert results(rig.command(245, 1, confirmation=1)) == [IN_PROGRESS]  # a retry
    assert results(rig.command(245, 1)) == [REJECTED]  # another one
    rig.request_handler.waiting.pop(0)(True)
    assert results(rig.replies()) == [ACCEPTED]
    assert results(rig.ticks(30)) == []


def test_storage_is_under_way_until_the_disk_has_answered_however_long_that_takes(rig, texts):
    """An answer before that might be wrong: what hangs may be stored in the end."""
    rig.request_handler.at_once = False
    rig.command(245, 1)
    replies = [*rig.tick(seconds=31.0), *rig.tick(seconds=3600.0)]
    assert results(replies) == [IN_PROGRESS] * 2
    assert results(rig.command(245, 1, confirmation=1)) == [REJECTED]  # that was long ago: another one
    (stored,) = rig.request_handler.waiting
    stored(True)
    replies = rig.replies()
    assert (results(replies), texts(replies)[-1]) == ([ACCEPTED], "All settings stored")
    assert results(rig.ticks(30)) == []


def test_one_that_takes_too_long_has_failed_and_a_late_end_is_not_reported_again(rig, compass, texts):
    rig.command(241, 0, 1)
    replies = rig.tick(seconds=901.0, **BENCH)
    assert (results(replies), texts(replies)[-1]) == ([FAILED], "PREFLIGHT_CALIBRATION: not done in time")
    assert results(rig.ticks(30)) == []


def test_what_a_failing_disk_leaves_in_force_is_said(rig, texts):
    rig.request_handler.at_once = False
    reports = {
        (241, 0, 0, 0, 2): "PREFLIGHT_CALIBRATION: RUD_CENTRE_DEG is in force but could not be stored",
        (245, 1): "PREFLIGHT_STORAGE: not all stored; retrying",
        (245, 2): "PREFLIGHT_STORAGE: not stored, parameters unchanged",
    }
    rig.tick(**BENCH)
    for (number, *values), text in reports.items():
        rig.command(number, *values)
        rig.request_handler.waiting.pop()(False)
        replies = rig.replies()
        assert (results(replies), texts(replies)) == ([FAILED], [text])


def test_what_cannot_be_cancelled_goes_on(rig):
    rig.request_handler.at_once = False
    rig.command(245, 1)
    assert rig.tell(rig_cancel(245)) == []
    rig.request_handler.waiting.pop()(True)
    assert results(rig.replies()) == [ACCEPTED]


def rig_cancel(command):
    return mavlink.mavlink_map[80](1, 1, command)


def test_a_cancelled_command_is_acknowledged_as_such():
    calls = []
    pending = PendingCommand(timeout_s=10.0, percent=lambda: 40, cancel=lambda: calls.append("cancelled"))
    pending.begin(0.0, calls.append)
    assert not pending.progress_due(0.2)
    assert pending.progress_due(0.4)
    assert not pending.progress_due(0.5)
    assert pending.percent() == 40
    assert pending.cancel()
    pending.finish(Answer(Verdict.ACCEPTED))
    assert calls == ["cancelled"]
    assert not pending.cancel()


def test_parameters_are_set_once(rig):
    rig.tick(armed=False)
    rig.command(42006, 60)
    assert [intent for intent in rig.request_handler.intents if isinstance(intent, SetParameter)] != []
    rig.command(42006, 60, confirmation=1)
    assert len(rig.request_handler.intents) == 1


# ------------------------------------------------------------------ a compass that calibrates itself


class FakeCompass:
    """Calibrates when reported; the test says how far it is."""

    def __init__(self):
        self.now = Calibration()
        self.there = True
        self.called_off = 0

    def calibrate(self, now_s):
        self.now = Calibration(CalibrationState.RUNNING, 25)
        return self.there

    def calibration(self):
        return self.now

    def cancel(self):
        self.called_off += 1
        self.now = Calibration()


@pytest.fixture
def compass(rig):
    made = FakeCompass()
    rig.endpoint._context.suppliers = msgspec.structs.replace(rig.endpoint._context.suppliers, calibrator=made)
    rig.tick(armed=False)
    return made


def test_a_compass_under_calibration_reports_its_progress_and_its_end(rig, compass, texts):
    assert texts(rig.command(241, 0, 1)) == ["Compass calibration: turn a full circle by hand, ashore"]
    acks = [message for message in rig.ticks(10) if message.get_type() == "COMMAND_ACK"]
    assert [(ack.result, ack.progress) for ack in acks] == [(IN_PROGRESS, 25)]
    compass.now = Calibration(CalibrationState.DONE, 100, "Compass calibrated")
    replies = rig.tick()
    assert (results(replies), texts(replies)) == ([ACCEPTED], ["Compass calibrated"])
    assert results(rig.ticks(20)) == []


@pytest.mark.parametrize(
    ("end", "text"),
    [
        (Calibration(CalibrationState.FAILED, 100, "score 9"), "score 9"),
        (Calibration(), "Compass calibration aborted"),
    ],
)
def test_a_calibration_that_fails_says_why(rig, compass, texts, end, text):
    rig.command(241, 0, 1)
    compass.now = end
    replies = rig.tick()
    assert (results(replies), texts(replies)) == ([FAILED], [text])


def test_a_calibration_can_be_cancelled_by_anybody_once(rig, compass):
    rig.command(241, 0, 1)
    assert results(rig.tell(rig_cancel(241))) == [CANCELLED]
    assert compass.called_off == 1
    assert rig.tell(rig_cancel(241)) == []
    assert results([message for _ in range(20) for message in rig.tick(armed=False)]) == []
    rig.command(241, 0, 1)
    assert results(rig.tick(seconds=901.0)) == [FAILED]
    assert compass.called_off == 2
    assert results(rig.ticks(20)) == []


def test_no_calibration_while_armed_or_without_the_compass(rig, compass):
    compass.there = False
    assert results(rig.command(241, 0, 1)) == [REJECTED]
    rig.tick(armed=True)
    assert results(rig.command(241, 0, 1)) == [REJECTED]
