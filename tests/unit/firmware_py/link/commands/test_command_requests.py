"""Requests of messages, once and at an interval."""

import math
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.mode_table import Mode
from firmware_py.common.records import CalibrationState, DepthSample, FixType, PositionSample, RudderFeedback
from firmware_py.common.reports import Activity, Home, MissionReport, Navigation, Power, SwingReport, Wind
from firmware_py.link.telemetry.table import TABLE

FIX = {"position": PositionSample(0.0, FixType.FIX_3D, 0.7, 0.2), "position_ok": True}
SERVO = {"servo": RudderFeedback(0.0, 0.1, 30.0, 12.0, 0.2)}
# Messages
HEARTBEAT, ATTITUDE, GLOBAL_POSITION_INT, HOME_POSITION, MESSAGE_INTERVAL = 0, 30, 33, 242, 244
AUTOPILOT_VERSION, PROTOCOL_VERSION, COMPONENT_INFORMATION, COMPONENT_METADATA = 148, 300, 395, 397
MAG_CAL_REPORT, AIS_VESSEL, AVAILABLE_MODES = 192, 301, 435
UNKNOWN = 25  # GPS_STATUS, which the boat does not send
# Commands
GET_HOME, GET_INTERVAL, SET_INTERVAL, REQUEST = 410, 510, 511, 512
REQUEST_PROTOCOL_VERSION, REQUEST_CAPABILITIES = 519, 520
ACCEPTED, NOT_NOW, DENIED, UNSUPPORTED = range(4)  # MAV_RESULT

OTHERS = {AUTOPILOT_VERSION, PROTOCOL_VERSION, COMPONENT_INFORMATION, COMPONENT_METADATA, AVAILABLE_MODES}
ALL_STREAMS = mavlink.MAV_DATA_STREAM_ALL


def result(messages):
    return next(message.result for message in messages if message.get_type() == "COMMAND_ACK")


@pytest.mark.parametrize("number", sorted({row.number for row in TABLE} - {AIS_VESSEL} | OTHERS))
def test_every_message_can_be_requested(rig, number):
    swing = SwingReport(CalibrationState.DONE if number == MAG_CAL_REPORT else CalibrationState.RUNNING)
    rig.request_handler.compass_swing = SimpleNamespace(report=swing)
    rig.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1600, 0, 0, 0, 0, 0, 0, 0))
    changes = {"home": Home(0.7, -0.2, 1.0), "navigation": Navigation(Activity.LINE, 0.7, -0.2)}
    changes |= {"wind": Wind(1.0, north_m_s=1.0, east_m_s=2.0), "wind_ok": True, "depth": DepthSample(1.0, 12.0)}
    rig.tick(**FIX, **SERVO, **changes, power=Power(12.6), mission=MissionReport(identities=(0, 7, 0)))
    replies = rig.command(REQUEST, number)
    assert replies[0].result == ACCEPTED
    assert {message.get_msgId() for message in replies[1:]} == {number}


@pytest.mark.parametrize("number", [math.nan, math.inf, -1, 0.5, 1e30, 16_777_216, UNKNOWN])
def test_request_of_an_unknown_message_is_refused(rig, number):
    assert [message.result for message in rig.command(REQUEST, number)] == [UNSUPPORTED]


@pytest.mark.parametrize(
    "command", [(GET_HOME,), *((REQUEST, number) for number in (HOME_POSITION, GLOBAL_POSITION_INT, AIS_VESSEL))]
)
def test_message_without_content_is_temporarily_rejected(rig, command):
    assert result(rig.command(*command)) == NOT_NOW


def test_home_is_reported_after_a_change_and_on_request(rig, of):
    home = {"home": Home(0.7, -0.2, 1.0)}
    (report,) = of(rig.tick(**home), "HOME_POSITION")
    assert of(rig.tick(**home), "HOME_POSITION") == []
    (requested,) = of(rig.command(GET_HOME), "HOME_POSITION")
    assert report.latitude == requested.latitude == round(math.degrees(0.7) * 1e7)
    (moved,) = of(rig.tick(home=Home(0.8, -0.2, 1.0)), "HOME_POSITION")
    assert moved.latitude == round(math.degrees(0.8) * 1e7)


def test_version_and_capabilities(rig, of):
    (version,) = of(rig.command(REQUEST_CAPABILITIES, 1), "AUTOPILOT_VERSION")
    assert version.flight_sw_version == 1 << 16
    assert version.flight_sw_version & 0xFF == mavlink.FIRMWARE_VERSION_TYPE_DEV
    assert bytes(version.flight_custom_version) == b"0123abcd"
    assert version.uid == 77
    for name in ("PARAM_ENCODE_C_CAST", "MISSION_INT", "FTP"):
        assert version.capabilities & getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{name}")
    assert len(of(rig.command(REQUEST_PROTOCOL_VERSION, 1), "PROTOCOL_VERSION")) == 1


ALL = list(range(1, len(Mode) + 2))  # including the mode before the first tick


@pytest.mark.parametrize(("index", "numbers"), [(0, ALL), (math.nan, ALL), (3, [3]), (len(ALL) + 1, []), (-1, [])])
def test_available_modes_are_sent_by_index(rig, of, index, numbers):
    assert [mode.mode_index for mode in of(rig.command(REQUEST, AVAILABLE_MODES, index), "AVAILABLE_MODES")] == numbers


def test_interval_is_set_and_reported(rig, of):
    assert result(rig.command(SET_INTERVAL, ATTITUDE, 500_000)) == ACCEPTED
    assert len(of(rig.ticks(40), "ATTITUDE")) == pytest.approx(8, abs=1)
    for replies in (rig.command(GET_INTERVAL, ATTITUDE), rig.command(REQUEST, MESSAGE_INTERVAL, ATTITUDE)):
        (report,) = of(replies, "MESSAGE_INTERVAL")
        assert (result(replies), report.message_id, report.interval_us) == (ACCEPTED, ATTITUDE, 500_000)
    for unknown, number in ((UNKNOWN, UNKNOWN), (math.nan, 0), (-1, 0), (65535, 65535)):
        replies = rig.command(REQUEST, MESSAGE_INTERVAL, unknown)
        (report,) = of(replies, "MESSAGE_INTERVAL")
        assert (result(replies), report.message_id, report.interval_us) == (UNSUPPORTED, number, 0)
    replies = rig.command(GET_INTERVAL, 65536)
    assert (result(replies), of(replies, "MESSAGE_INTERVAL")) == (UNSUPPORTED, [])
    rig.command(SET_INTERVAL, ATTITUDE, 3600e6)
    assert of(rig.command(GET_INTERVAL, ATTITUDE), "MESSAGE_INTERVAL")[0].interval_us == 2_147_483_647


def test_each_peer_has_separate_intervals(make_rig, of):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    rig.send(mavlink.MAVLink_command_long_message(1, 1, SET_INTERVAL, 0, ATTITUDE, -1, 0, 0, 0, 0, 0), address="one")
    for address, expected in (("one", 0), ("two", 1)):
        rig.tick_silently()
        assert len(of(rig.replies(address), "ATTITUDE")) == expected


@pytest.mark.parametrize("interval_us", [math.nan, math.inf, -2, 1, 1e30])
def test_invalid_interval_is_refused(rig, interval_us):
    assert result(rig.command(SET_INTERVAL, ATTITUDE, interval_us)) == DENIED


def test_heartbeat_cannot_be_switched_off(rig, of):
    assert result(rig.command(SET_INTERVAL, HEARTBEAT, -1)) == DENIED
    assert len(of(rig.tick(seconds=1.0), "HEARTBEAT")) == 1


@pytest.mark.parametrize("number", [math.nan, UNKNOWN, 65535, 65536, -1])
def test_interval_of_an_unknown_message_is_refused(rig, number):
    assert result(rig.command(GET_INTERVAL, number)) == UNSUPPORTED
    assert result(rig.command(SET_INTERVAL, number, 1e6)) == UNSUPPORTED


def test_request_data_stream_sets_and_stops_a_rate(rig, of):
    rig.send(mavlink.MAVLink_request_data_stream_message(1, 1, ALL_STREAMS, 2, 1))
    assert len(of(rig.ticks(50), "ATTITUDE")) == pytest.approx(10, abs=1)
    rig.send(mavlink.MAVLink_request_data_stream_message(1, 1, ALL_STREAMS, 2, 0))
    assert of(rig.ticks(50), "ATTITUDE") == []
