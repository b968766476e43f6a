"""A satellite link sends only requested messages."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Event, FixType, PositionSample, RudderFeedback, Severity
from firmware_py.common.reports import Home, MissionReport, MissionState
from firmware_py.faults.table import Fault
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.urls import LinkClass, LinkOptions
from support.link import results

YAW, SET_INTERVAL = mavlink.MAV_CMD_CONDITION_YAW, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST, HIGH_LATENCY = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_CONTROL_HIGH_LATENCY
HEARTBEAT, GLOBAL_POSITION_INT, HIGH_LATENCY2, EXTENDED_SYS_STATE = 0, 33, 235, 245  # messages
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
COMPASS_FAILURE = mavlink.HL_FAILURE_FLAG_3D_MAG | mavlink.HL_FAILURE_FLAG_ESTIMATOR
SATELLITE = LinkOptions(link_class=LinkClass.SATELLITE)
FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, math.pi / 2, 8, 1.25)


@pytest.fixture
def satellite(make_rig):
    return make_rig(options=SATELLITE)


def test_nothing_is_sent_without_a_request(satellite):
    satellite.endpoint.service(0.0, [])
    for second in range(600):
        mode = Mode.HOLD if second % 7 else Mode.GUIDED
        events = [Event(Severity.CRITICAL, f"Something {second}")]
        home = Home(0.7, -0.2, float(second))
        satellite.tick_silently(seconds=1.0, events=events, mode=mode, home=home, position=FIX, position_ok=True)
    assert satellite.transport.sent == []


def test_high_latency2_is_sent_at_its_interval_until_disabled(satellite):
    satellite.tick()
    assert results(satellite.command(HIGH_LATENCY, 1)) == [ACCEPTED]
    replies = satellite.ticks(6000)  # ten minutes
    assert {message.get_type() for message in replies} == {"HIGH_LATENCY2"}
    assert len(replies) == pytest.approx(600 / 120, abs=1)
    assert results(satellite.command(HIGH_LATENCY, 0)) == [ACCEPTED]
    assert satellite.ticks(3000) == []


def test_high_latency2_is_short(satellite):
    satellite.tick()
    satellite.command(HIGH_LATENCY, 1)
    satellite.tick_silently()
    ((_, data),) = satellite.transport.sent
    assert len(data) <= 42 + 12


def test_requests_get_replies(satellite, of, texts):
    satellite.tick()
    assert results(satellite.command(YAW, 90)) == [ACCEPTED]
    assert len(of(satellite.command(REQUEST, HIGH_LATENCY2), "HIGH_LATENCY2")) == 1
    assert len(of(satellite.command(REQUEST, HEARTBEAT), "HEARTBEAT")) == 1
    replies = satellite.command(YAW, math.nan)
    assert results(replies) == [DENIED]
    assert len(texts(replies)) == 1
    assert of(satellite.send(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 33.0, 9)), "PARAM_VALUE")


def test_messages_to_all_peers_are_not_sent_by_satellite(satellite):
    satellite.tick()
    (peer,) = satellite.endpoint._peers
    satellite.endpoint._context.send_all(mavlink.MAVLink_ping_message(0, 0, 0, 0))
    satellite.endpoint._context.send_text_all(Severity.CRITICAL, "text")
    assert peer.outbox.queued_count(Priority.TELEMETRY) == 0


def test_high_rates_are_rejected_and_long_intervals_accepted(satellite):
    satellite.tick()
    satellite.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    assert results(satellite.command(SET_INTERVAL, EXTENDED_SYS_STATE, 1e6)) == [DENIED]
    assert satellite.ticks(600) == []
    assert results(satellite.command(SET_INTERVAL, GLOBAL_POSITION_INT, 60e6)) == [ACCEPTED]
    replies = [message for _ in range(600) for message in satellite.tick(seconds=1.0, position=FIX, position_ok=True)]
    assert {message.get_type() for message in replies} == {"GLOBAL_POSITION_INT"}
    assert len(replies) == pytest.approx(10, abs=1)


def test_request_on_another_link_enables_present_and_later_satellite_peers(make_rig):
    rig = make_rig()
    satellite = make_rig(options=SATELLITE, descriptor=101).transport
    rig.endpoint = Endpoint([rig.transport, satellite], rig.request_handler, utc_s=lambda: 1.7e9, version=Version())
    rig.tick()
    rig.command(HIGH_LATENCY, 1)
    rig.tick_silently()
    assert len(satellite.sent) == 1
    satellite.served = ("station", "another")
    rig.tick_silently()
    rig.tick_silently()
    assert [address for address, _ in satellite.sent] == ["station", "another"]


@pytest.mark.parametrize("value", [2, -1, 0.5, math.nan, math.inf])
def test_value_other_than_on_or_off_is_denied(satellite, value):
    satellite.tick()
    assert results(satellite.command(HIGH_LATENCY, value)) == [DENIED]
    assert satellite.ticks(20) == []


def test_high_latency2_contains_position_goal_and_faults(satellite, of):
    satellite.tick(
        position=FIX,
        position_ok=True,
        mode=Mode.AUTO,
        heading_rad=math.radians(359.5),
        goal_heading_rad=math.radians(90.0),
        bearing_rad=1.0,
        distance_m=1234.0,
        servo=RudderFeedback(0.0, 0.1, voltage_v=12.2),
        rudder_rad=math.radians(-11.6),
        faults=1 << Fault.RUDDER_SILENT | 1 << Fault.COMPASS_LOST,
        mission=MissionReport(MissionState.ACTIVE, 6, 9),
    )
    (report,) = of(satellite.command(REQUEST, HIGH_LATENCY2), "HIGH_LATENCY2")
    assert (report.type, report.autopilot, report.custom_mode) == (
        mavlink.MAV_TYPE_SURFACE_BOAT, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, Mode.AUTO,
    )  # fmt: skip
    assert (report.latitude, report.longitude, report.altitude) == (
        round(math.degrees(0.7) * 1e7), round(math.degrees(-0.2) * 1e7), 3,
    )  # fmt: skip
    assert (report.heading, report.target_heading, report.target_distance, report.groundspeed) == (0, 45, 123, 2)
    assert (report.wp_num, report.battery, report.eph) == (7, -1, 255)
    assert report.failure_flags == COMPASS_FAILURE | mavlink.HL_FAILURE_FLAG_ENGINE
    assert (report.custom0, report.custom1, report.custom2) == (-12, 61, 1 | 2)  # armed, valid heading


def test_high_latency2_marks_an_estimated_rudder_angle(satellite, of):
    satellite.tick(rudder_rad=None, rudder_estimate_rad=math.radians(7.6))
    (report,) = of(satellite.command(REQUEST, HIGH_LATENCY2), "HIGH_LATENCY2")
    assert (report.custom0, report.custom2 & 4) == (8, 4)  # 4: estimated


def test_power_saving_is_reported_at_once_and_extends_the_interval(satellite):
    satellite.tick()
    satellite.command(HIGH_LATENCY, 1)
    satellite.ticks(100)
    low = {"power_saving_level": 1, "faults": 1 << Fault.BATTERY_LOW}
    (report,) = satellite.tick(**low)
    assert report.failure_flags & mavlink.HL_FAILURE_FLAG_BATTERY
    later = [message for _ in range(6000) for message in satellite.tick(**low)]
    assert len(later) == pytest.approx(600 / (5 * 120), abs=1)
    assert len(satellite.tick()) == 1  # the end of power saving
