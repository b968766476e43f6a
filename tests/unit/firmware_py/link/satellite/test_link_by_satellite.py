"""Satellite link with an emulated modem and network, in simulated time."""

import os
import select
from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SetMode
from firmware_py.common.link_status import SatelliteStatus
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Event, Severity
from firmware_py.link.satellite.messages import Kind
from firmware_py.link.satellite.record import from_bytes
from support.link import MemoryVault
from support.satellite import KEY, SatelliteBoat, set_mode

DAY_S = 86400.0


@pytest.fixture
def boat():
    return SatelliteBoat(key=KEY)


def names(frames):
    return [frame.get_type() for frame in frames]


def run_voyage(hours):
    """Run hours with a report each, faults, commands and 30 % of failed sessions, and check the results."""
    boat = SatelliteBoat(key=KEY, failed=0.3, lost_replies=0.2, lost_alerts=0.3, seed=7)
    messages, executed, faults, frames = [], 0, [], []
    for hour in range(hours):
        boat.run_to(3600.0 * hour + 1800.0, idle_s=60.0)
        if hour % 12 == 5:
            faults.append(f"Fault {hour}")
            boat.publish_events(Event(Severity.ERROR, faults[-1]))
        if hour % 8 == 3:
            messages.append(boat.keyed(set_mode(Mode.GUIDED)))
            executed += 1
            for message in (messages[-1], messages[0]):  # a new message and a repeated one
                boat.network.send(message)
        boat.run_to(3600.0 * (hour + 1), idle_s=60.0)
        assert boat.network.bill.total <= boat.status().total_credits
        frames += boat.delivered()
    by_day = Counter()
    for at_s, credits_ in boat.network.charges:
        by_day[int(at_s // DAY_S)] += credits_
    reports = {frame.timestamp for frame in frames if frame.get_type() == "HIGH_LATENCY2"}
    texts = {frame.text for frame in frames if frame.get_type() == "STATUSTEXT"}
    status = boat.status()
    assert boat.network.attempts > 1.3 * hours
    assert max(by_day.values()) <= boat.request_handler.values["SBD_DAY_CRED"]
    queued = len(boat.transport._driver.queue._queues[Kind.REPORT])
    assert (status.dropped, len(reports)) == (0, hours + 1 - queued)
    assert set(faults) <= texts
    assert boat.intents == [SetMode(Mode.GUIDED)] * executed
    assert status.refused == {"came before": len(messages) * 2 - executed}
    return boat, f"{len(reports)} reports, {boat.network.bill}, {dict(by_day)}, {status}"


def test_failed_sessions_lose_no_message_within_the_budget():
    run_voyage(12)


@pytest.mark.proof
def test_failed_sessions_of_a_month_lose_no_message_within_the_budget():
    """It takes four minutes; `-s` prints the summary."""
    boat, summary = run_voyage(24 * 30)
    print(summary)
    assert boat.network.bill.total <= boat.status().total_credits <= boat.request_handler.values["SBD_MONTH_CRED"]


def test_report_costs_one_credit(boat):
    boat.run(60)
    assert names(boat.delivered()) == ["HIGH_LATENCY2"]
    assert boat.network.bill.total == 1
    status = boat.status()
    assert 20.0 < status.session_age_s < 40.0
    assert status == SatelliteStatus(
        imei="300234010753370", signal=5, waiting=0, dropped=0, sessions=1, failed=0, last_status=0, blocked_reason="",
        session_age_s=status.session_age_s, sent=1, sent_bytes=50, received=0, refused={}, day_credits=1, day_limit=50,
        month_credits=1, month_limit=1500, total_credits=1,
    )  # fmt: skip


def test_only_changes_are_reported_with_interval_zero():
    boat = SatelliteBoat(parameters={"SBD_REPORT_MIN": 0})
    boat.run(7200, idle_s=30)
    assert len(boat.delivered()) == 1  # the first report
    boat.changes["mode"] = Mode.HOLD
    boat.run(60)
    (report,) = boat.delivered()
    assert report.custom_mode == Mode.HOLD


def test_mode_change_and_warning_are_sent_at_once_but_no_notice(boat):
    boat.run(60)
    boat.delivered()
    boat.changes["mode"] = Mode.HOLD
    boat.publish_events(Event(Severity.ERROR, "Compass lost: " + 60 * "x"), Event(Severity.NOTICE, "Home set"))
    boat.run(90)
    frames = boat.delivered()
    assert sorted(names(frames)) == ["HIGH_LATENCY2", "STATUSTEXT"]
    assert [len(frame.text) for frame in frames if frame.get_type() == "STATUSTEXT"] == [37]
    assert boat.status().day_credits == 3


def test_six_texts_are_sent_at_once_then_two_per_hour_and_equal_ones_once_per_hour(boat):
    station = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def is_sent(now_s, text):
        boat.transport.poll(now_s)
        dropped = boat.status().dropped
        assert boat.transport.send("shore", mavlink.MAVLink_statustext_message(4, text).pack(station))
        return boat.status().dropped == dropped

    times_s = {b"a": (10.0, 11.0, 3609.0, 3610.0, 7209.0, 7210.0), b"b": (5000.0, 5001.0, 8600.0)}
    sent = {
        (now_s, text): is_sent(now_s, text)
        for now_s, text in sorted((t, text) for text in times_s for t in times_s[text])
    }
    assert [now_s for (now_s, _), is_ok in sent.items() if is_ok] == [10.0, 3610.0, 5000.0, 7210.0, 8600.0]
    several = [is_sent(100_000.0, b"%d" % number) for number in range(7)]
    assert several == [True] * 6 + [False]
    assert [is_sent(100_000.0 + after_s, b"late") for after_s in (1799.0, 1800.0)] == [False, True]
    assert not is_sent(101_800.0, b"later")


def test_command_is_executed_and_acknowledged(boat):
    assert select.select([boat.transport.descriptors()[-1]], [], [], 0.0)[0] == []
    boat.run(60)
    boat.delivered()
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED)))
    boat.run(90)
    assert boat.intents == [SetMode(Mode.GUIDED)]
    assert select.select([boat.transport.descriptors()[-1]], [], [], 0.0)[0] == []  # the loop sleeps
    assert [(frame.command, frame.result) for frame in boat.delivered() if frame.get_type() == "COMMAND_ACK"] == [
        (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    ]


def test_messages_out_of_order_and_days_late_are_executed_once():
    boat = SatelliteBoat(key=KEY, parameters={"SBD_REPORT_MIN": 1440.0})
    boat.run(4 * DAY_S, idle_s=3600)
    ages_s = {Mode.HOLD: 0, Mode.AUTO: 3 * DAY_S, Mode.RTL: 60}
    messages = [boat.keyed(set_mode(mode), at_s=boat.now_s - age_s) for mode, age_s in ages_s.items()]
    for message in messages * 2:
        boat.network.send(message)
    boat.run(900)
    assert [intent.mode for intent in boat.intents] == [Mode.HOLD, Mode.AUTO, Mode.RTL]
    assert boat.status().refused == {"came before": 3}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"key": bytes(31) + b"\x01"}, "false code"),
        ({"imei": "300234010753371"}, "false code"),
        ({"at_s": -7 * DAY_S}, "too old"),
        ({"at_s": DAY_S + 130.0}, "written in the future"),
    ],
)
def test_forged_or_outdated_message_is_refused(boat, changes, reason):
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED), **changes))
    boat.run(120)
    assert boat.intents == []
    assert boat.status().refused == {reason: 1}
    assert [event.text for event in boat.events] == [f"Satellite message refused: {reason}"]


@pytest.mark.parametrize("at_s", [130.0 - 7 * DAY_S, DAY_S])
def test_message_of_a_week_ago_or_a_day_ahead_is_executed(boat, at_s):
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED), at_s=at_s))
    boat.run(120)
    assert (boat.intents, boat.status().refused) == ([SetMode(Mode.GUIDED)], {})


def test_restart_keeps_credits_and_executed_messages(boat):
    message = boat.keyed(set_mode(Mode.GUIDED))
    boat.network.send(message)
    boat.run(90)
    credits_before = boat.status().day_credits
    boat.endpoint.close()
    boat.start(KEY)
    assert boat.status().day_credits == credits_before
    boat.network.send(message)
    boat.run(90)
    assert boat.intents == [SetMode(Mode.GUIDED)]


@pytest.mark.parametrize(
    ("content", "damage", "report"),
    [
        (b"ledger 1 2\n", "", "Satellite record damaged, new one started: "),
        (None, "satellite.state.0 is of another version", ""),
        (b"\x82\xa7version\x01\xa4sent\x03", "", "Satellite record: Record: field 'sent' is not known here, ignored"),
    ],
)
def test_older_messages_are_refused_after_loss_of_the_record(content, damage, report):
    vault = MemoryVault()
    vault.contents += [] if content is None else [content]
    vault.damage = damage
    boat = SatelliteBoat(key=KEY, vault=vault)
    vault.damage = ""
    boat.endpoint.close()
    boat.start(KEY)
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED), at_s=-60.0))
    boat.run(90)
    boat.network.send(boat.keyed(set_mode(Mode.HOLD)))
    boat.run(90)
    assert boat.intents == [SetMode(Mode.HOLD)]
    reports = [event.text for event in boat.events if event.text.startswith("Satellite record")]
    assert [text.startswith(report) for text in reports] == [True] * bool(report)


def test_loss_of_the_record_before_2015_is_no_error(monkeypatch):
    monkeypatch.setattr("support.satellite.START_UTC_S", 1e9)
    vault = MemoryVault()
    vault.damage = "satellite.state.0 is damaged"
    SatelliteBoat(vault=vault)
    assert from_bytes(vault.contents[-1])[0].window.floor == 0


def test_message_is_executed_after_its_number_is_stored(boat):
    boat.vault.at_once = False
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED)))
    boat.run(90)
    assert boat.intents == []
    boat.vault.waiting.pop()(True)
    assert select.select([boat.transport.descriptors()[-1]], [], [], 0.0)[0]  # it wakes the loop
    boat.run(1)
    assert boat.intents == [SetMode(Mode.GUIDED)]


def test_plain_frame_may_command_only_without_a_key(boat):
    plain = set_mode(Mode.GUIDED).pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
    boat.network.send(plain)
    boat.run(120)
    assert boat.intents == []
    assert boat.transport.is_exposed
    open_boat = SatelliteBoat()
    for message in (plain, plain[:-1], boat.keyed(set_mode(Mode.HOLD))):
        open_boat.network.send(message)
    open_boat.run(180)
    assert open_boat.intents == [SetMode(Mode.GUIDED)]
    assert open_boat.status().refused == {"no whole frame": 1, "there is no key": 1}


def test_numbers_of_the_last_32_messages_without_a_key_are_stored():
    boat = SatelliteBoat()
    plain = set_mode(Mode.GUIDED).pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
    boat.transport._driver.received = [(number, plain) for number in (*range(33), 1, 0)]
    boat.run(1)
    assert boat.status().refused == {"came before": 1}


def test_used_credits_delay_reports_to_the_next_day_but_not_commands():
    boat = SatelliteBoat(key=KEY, parameters={"SBD_DAY_CRED": 10, "SBD_REPORT_MIN": 30.0})
    boat.run(12 * 3600.0, idle_s=600)
    assert boat.status().day_credits == 9
    assert boat.network.bill.total == 9
    assert [event.text for event in boat.events] == ["Satellite credits used up: 9 today, 9 this month"]
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED)))
    boat.run(300)
    assert boat.intents == [SetMode(Mode.GUIDED)]
    boat.run(12.5 * 3600.0, idle_s=600)
    assert boat.status().day_credits > 0
    assert boat.status().waiting > 0  # reports of the day before
    assert boat.network.bill.total <= boat.status().total_credits


def test_session_waits_for_a_sufficient_signal():
    boat = SatelliteBoat(signal=lambda now_s: 1 if now_s < 900.0 else 4)
    boat.run(890, idle_s=5)
    assert boat.network.attempts == 0
    boat.run(180)
    assert names(boat.delivered()) == ["HIGH_LATENCY2"]


def test_ambiguous_failures_do_not_use_up_the_credits_of_a_day():
    boat = SatelliteBoat(failed=1.0, lost_replies=1.0)
    boat.run(DAY_S / 2, idle_s=120)
    status = boat.status()
    assert boat.network.bill.total <= status.day_credits <= 45
    assert boat.network.attempts < 30


def test_silent_modem_is_reported_and_recovers(boat):
    boat.run(60)
    receive, boat.modem.receive = boat.modem.receive, lambda *_: None
    boat.changes["mode"] = Mode.HOLD
    boat.run(300, idle_s=5)
    boat.modem.receive = receive
    boat.run(300, idle_s=5)
    texts = [event.text for event in boat.events]
    assert texts == ["Satellite modem not responding", "Satellite modem recovered"]
    assert "HIGH_LATENCY2" in names(boat.delivered())


def test_modem_is_set_up_again_after_its_line_was_lost(boat):
    boat.run(60)
    boat.delivered()
    assert len(boat.transport.descriptors()) == 2
    boat.line.fileno = lambda: -1
    assert len(boat.transport.descriptors()) == 1
    del boat.line.fileno
    boat.line.openings += 1
    boat.run(0.5)
    assert not boat.transport._driver.modem.is_ready
    boat.changes["mode"] = Mode.HOLD
    boat.run(60)
    assert names(boat.delivered()) == ["HIGH_LATENCY2"]


def test_message_in_the_modem_is_read_after_a_power_cut(boat):
    boat.run(60)
    boat.modem._in_message, boat.modem._in_number = boat.keyed(set_mode(Mode.GUIDED)), 9
    boat.endpoint.close()
    boat.start(KEY)
    boat.run(60)
    assert boat.intents == [SetMode(Mode.GUIDED)]


def test_second_close_and_late_storage_do_not_touch_a_reused_descriptor(boat):
    boat.vault.at_once = False
    boat.network.send(boat.keyed(set_mode(Mode.GUIDED)))
    boat.run(90)
    boat.endpoint.close()
    with Path(os.devnull).open() as other_file:  # it reuses the number of the descriptor
        boat.transport.close()
        boat.vault.waiting.pop()(True)
        assert other_file.read() == ""


def test_control_high_latency_does_not_apply_to_paid_messages(boat):
    boat.run(60)
    boat.delivered()
    command = mavlink.MAV_CMD_CONTROL_HIGH_LATENCY
    boat.network.send(boat.keyed(mavlink.MAVLink_command_long_message(1, 1, command, 0, 1, 0, 0, 0, 0, 0, 0)))
    boat.run(1800, idle_s=30)
    assert "HIGH_LATENCY2" not in names(boat.delivered())


def test_key_is_not_set_by_satellite(boat):
    setup = mavlink.MAVLink_setup_signing_message(1, 1, bytes(range(1, 33)), 5)
    boat.network.send(boat.keyed(setup))
    boat.run(120)
    assert boat.endpoint._signing._key == KEY
