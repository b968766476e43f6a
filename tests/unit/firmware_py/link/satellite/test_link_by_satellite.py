"""The whole of a link by satellite, before an emulated modem and network in simulated time."""

import os
from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SetMode
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Event, Severity
from firmware_py.link.satellite.messages import Kind
from support.link import MemoryVault
from support.satellite import KEY, SatelliteBoat, set_mode

DAY_S = 86400.0


@pytest.fixture
def boat():
    return SatelliteBoat(key=KEY)


def names(frames):
    return [frame.get_type() for frame in frames]


def sail(hours):
    """Sail some hours with a report each, faults, commands and 30 % of sessions that fail; judge each hour."""
    boat = SatelliteBoat(key=KEY, failed=0.3, lost_replies=0.2, lost_alerts=0.3, seed=7)
    messages, obeyed, faults, frames = [], 0, [], []
    for hour in range(hours):
        boat.run_to(3600.0 * hour + 1800.0, idle_s=60.0)
        if hour % 12 == 5:
            faults.append(f"Fault {hour}")
            boat.tell(Event(Severity.ERROR, faults[-1]))
        if hour % 8 == 3:
            messages.append(boat.keyed(set_mode(15)))
            obeyed += 1
            for message in (messages[-1], messages[0]):  # and one that came long ago, again
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
    waiting = len(boat.transport._driver.queue._queues[Kind.REPORT])
    assert (status.dropped, len(reports)) == (0, hours + 1 - waiting)
    assert set(faults) <= texts
    assert boat.intents == [SetMode(15)] * obeyed
    assert status.refused == {"came before": len(messages) * 2 - obeyed}
    return boat, f"{len(reports)} reports, {boat.network.bill}, {dict(by_day)}, {status}"


def test_half_a_day_with_failed_sessions_loses_nothing_and_keeps_the_budget():
    sail(12)


@pytest.mark.proof
def test_so_does_a_month():
    """pytest -m proof -s tests/unit/firmware_py/link/satellite (four minutes)."""
    boat, reports = sail(24 * 30)
    print(reports)
    assert boat.network.bill.total <= boat.status().total_credits <= boat.request_handler.values["SBD_MONTH_CRED"]


def test_a_report_is_one_credit(boat):
    boat.run(60)
    assert names(boat.delivered()) == ["HIGH_LATENCY2"]
    assert (boat.status().sent_bytes, boat.status().day_credits, boat.network.bill.total) == (50, 1, 1)


def test_it_is_off_without_such_a_link_and_the_generic_satellite_stays_silent():
    boat = SatelliteBoat(parameters={"SBD_REPORT_MIN": 0})
    boat.run(7200, idle_s=30)
    assert len(boat.delivered()) == 1  # the boat says that the boat is there
    boat.changes["mode"] = Mode.HOLD
    boat.run(60)
    (report,) = boat.delivered()
    assert report.custom_mode == Mode.HOLD


def test_a_change_of_mode_goes_out_at_once_and_a_warning_too_but_no_notice(boat):
    boat.run(60)
    boat.delivered()
    boat.changes["mode"] = Mode.HOLD
    boat.tell(Event(Severity.ERROR, "Compass lost: " + 60 * "x"), Event(Severity.NOTICE, "Home set"))
    boat.run(90)
    frames = boat.delivered()
    assert sorted(names(frames)) == ["HIGH_LATENCY2", "STATUSTEXT"]
    assert [len(frame.text) for frame in frames if frame.get_type() == "STATUSTEXT"] == [37]
    assert boat.status().day_credits == 3


def test_who_says_the_same_all_day_costs_no_day(boat):
    for second in range(300):
        boat.tell(Event(Severity.ERROR, "Compass lost"), Event(Severity.ERROR, f"Fault {second}"))
        boat.run(12, idle_s=6)
        boat.changes["mode"] = Mode.HOLD if second % 2 else Mode.GUIDED
    texts = [frame.text for frame in boat.delivered() if frame.get_type() == "STATUSTEXT"]
    assert texts.count("Compass lost") <= 2
    assert len(texts) <= 9
    assert boat.status().day_credits <= 25
    assert boat.status().dropped > 500


def test_a_command_comes_with_a_ring_and_is_answered(boat):
    boat.run(60)
    boat.delivered()
    boat.network.send(boat.keyed(set_mode(15)))
    boat.run(90)
    assert boat.intents == [SetMode(15)]
    assert [(frame.command, frame.result) for frame in boat.delivered() if frame.get_type() == "COMMAND_ACK"] == [
        (176, 0)
    ]


def test_messages_out_of_order_and_days_late_count_once_each():
    boat = SatelliteBoat(key=KEY, parameters={"SBD_REPORT_MIN": 1440.0})
    boat.run(4 * DAY_S, idle_s=3600)
    written = [
        boat.keyed(set_mode(mode), at_s=boat.now_s - age_s) for mode, age_s in ((4, 0), (10, 3 * DAY_S), (11, 60))
    ]
    for message in written * 2:
        boat.network.send(message)
    boat.run(900)
    assert [intent.mode for intent in boat.intents] == [4, 10, 11]
    assert boat.status().refused == {"came before": 3}


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"key": bytes(31) + b"\x01"}, "false code"),
        ({"imei": "300234010753371"}, "false code"),
        ({"at_s": -8 * DAY_S}, "too old"),
        ({"at_s": 2 * DAY_S}, "written in the future"),
    ],
)
def test_what_is_forged_for_another_modem_or_out_of_time_changes_nothing(boat, more, reason):
    boat.network.send(boat.keyed(set_mode(15), **more))
    boat.run(120)
    assert boat.intents == []
    assert boat.status().refused == {reason: 1}
    assert [event.text for event in boat.events] == [f"Satellite message refused: {reason}"]


def test_a_restart_forgets_neither_what_was_spent_nor_what_has_counted(boat):
    message = boat.keyed(set_mode(15))
    boat.network.send(message)
    boat.run(90)
    spent = boat.status().day_credits
    boat.endpoint.close()
    boat.start(KEY)
    assert boat.status().day_credits == spent
    boat.network.send(message)
    boat.run(90)
    assert boat.intents == [SetMode(15)]


@pytest.mark.parametrize(
    ("content", "damage", "report"),
    [
        (b"ledger 1 2\n", "", "Satellite record damaged, new one started: "),
        (None, "satellite.state.0 is of another version", ""),
        (b"\x82\xa7version\x01\xa4sent\x03", "", "Satellite record: Record: field 'sent' is not known here, ignored"),
    ],
)
def test_without_a_whole_record_that_was_there_nothing_older_counts(content, damage, report):
    vault = MemoryVault()
    vault.contents += [] if content is None else [content]
    vault.damage = damage
    boat = SatelliteBoat(key=KEY, vault=vault)
    vault.damage = ""  # the next start finds the record that was begun
    boat.endpoint.close()
    boat.start(KEY)
    boat.network.send(boat.keyed(set_mode(15), at_s=-60.0))
    boat.run(90)
    boat.network.send(boat.keyed(set_mode(4)))
    boat.run(90)
    assert boat.intents == [SetMode(4)]
    reports = [event.text for event in boat.events if event.text.startswith("Satellite record")]
    assert [text.startswith(report) for text in reports] == [True] * bool(report)


def test_a_message_that_is_not_on_disk_yet_has_not_counted(boat):
    boat.vault.at_once = False
    boat.network.send(boat.keyed(set_mode(15)))
    boat.run(90)
    assert boat.intents == []
    boat.vault.waiting.pop()(True)
    boat.run(1)
    assert boat.intents == [SetMode(15)]


def test_with_a_key_a_plain_frame_may_ask_and_without_one_command(boat):
    plain = set_mode(15).pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
    boat.network.send(plain)
    boat.run(120)
    assert boat.intents == []
    assert boat.transport.exposed
    open_boat = SatelliteBoat()
    for message in (plain, plain[:-1], boat.keyed(set_mode(4))):
        open_boat.network.send(message)
    open_boat.run(180)
    assert open_boat.intents == [SetMode(15)]
    assert open_boat.status().refused == {"no whole frame": 1, "there is no key": 1}


def test_a_day_whose_credits_are_spent_lets_commands_in_and_the_next_day_reports():
    boat = SatelliteBoat(key=KEY, parameters={"SBD_DAY_CRED": 10, "SBD_REPORT_MIN": 30.0})
    boat.run(12 * 3600.0, idle_s=600)
    assert boat.status().day_credits == 9
    assert boat.network.bill.total == 9
    assert [event.text for event in boat.events] == ["Satellite credits used up: 9 today, 9 this month"]
    boat.network.send(boat.keyed(set_mode(15)))
    boat.run(300)
    assert boat.intents == [SetMode(15)]
    boat.run(12.5 * 3600.0, idle_s=600)
    assert boat.status().day_credits > 0
    assert boat.status().waiting > 0  # reports of the day before wait until there is room
    assert boat.network.bill.total <= boat.status().total_credits


def test_a_weak_signal_is_waited_for():
    boat = SatelliteBoat(signal=lambda now_s: 1 if now_s < 900.0 else 4)
    boat.run(890, idle_s=5)
    assert boat.network.attempts == 0
    boat.run(180)
    assert names(boat.delivered()) == ["HIGH_LATENCY2"]


def test_failures_are_followed_by_longer_pauses():
    boat = SatelliteBoat(failed=1.0)
    boat.run(3500, idle_s=10)
    assert 12 <= boat.network.attempts <= 22
    assert boat.status().waiting == 1
    boat.network.failed = 0.0
    boat.run(400, idle_s=5)
    assert "HIGH_LATENCY2" in names(boat.delivered())


def test_a_gateway_that_may_have_charged_each_try_does_not_use_up_the_day():
    boat = SatelliteBoat(failed=1.0, lost_replies=1.0)
    boat.run(DAY_S / 2, idle_s=120)
    status = boat.status()
    assert boat.network.bill.total <= status.day_credits <= 45
    assert boat.network.attempts < 30


def test_a_modem_that_is_switched_off_is_reported_and_taken_up_again(boat):
    boat.run(60)
    receive, boat.modem.receive = boat.modem.receive, lambda *_: None
    boat.changes["mode"] = Mode.HOLD
    boat.run(300, idle_s=5)
    boat.modem.receive = receive
    boat.run(300, idle_s=5)
    assert [event.text for event in boat.events] == [
        "Satellite modem not responding",
        "Satellite modem recovered",
    ]
    assert "HIGH_LATENCY2" in names(boat.delivered())


def test_a_message_received_before_a_power_cut_is_found_in_the_modem(boat):
    boat.run(60)
    boat.modem._in_message, boat.modem._in_number = boat.keyed(set_mode(15)), 9
    boat.endpoint.close()
    boat.start(KEY)
    boat.run(60)
    assert boat.intents == [SetMode(15)]


def test_it_may_be_closed_by_all_who_have_it_and_gives_nothing_of_others_away(boat):
    boat.vault.at_once = False
    boat.network.send(boat.keyed(set_mode(15)))
    boat.run(90)
    boat.endpoint.close()
    with Path(os.devnull).open() as another:  # which has the number of its descriptor now
        boat.transport.close()
        boat.vault.waiting.pop()(True)  # the disk has it after all
        assert another.read() == ""


def test_control_high_latency_is_not_for_it(boat):
    boat.run(60)
    boat.delivered()
    boat.network.send(boat.keyed(mavlink.MAVLink_command_long_message(1, 1, 2600, 0, 1, 0, 0, 0, 0, 0, 0)))
    boat.run(1800, idle_s=30)
    assert "HIGH_LATENCY2" not in names(boat.delivered())


def test_a_key_is_not_set_by_satellite(boat):
    setup = mavlink.MAVLink_setup_signing_message(1, 1, bytes(range(1, 33)), 5)
    boat.network.send(boat.keyed(setup))
    boat.run(120)
    assert boat.endpoint._signing._key == KEY
