"""Positions of a flight controller."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.common.records import DeviceState, FixType
from firmware_py.sensors.mavlink_frames import Message
from firmware_py.sensors.mavlink_position import MavlinkPosition, MavlinkPositionOptions
from support.flight_controller import Board, decode_all, requested, requested_streams

UTC_S = 1_767_225_600.25


def gps(fix=3, *, time_us=1, lat=36.5, lon=-121.25, eph=85, vel=47, cog=27000, satellites=14, accuracy_mm=1200):
    """Return a GPS_RAW_INT: position in degrees, eph in 0.01, vel in cm/s, cog in 0.01 deg."""
    return dialect.MAVLink_gps_raw_int_message(
        time_us, fix, round(lat * 1e7), round(lon * 1e7), 12345, eph, 130, vel, cog, satellites, 0, accuracy_mm
    )


def estimate(lat=36.6, lon=-121.35, north_cm_s=30, east_cm_s=-40):
    return dialect.MAVLink_global_position_int_message(
        10_000, round(lat * 1e7), round(lon * 1e7), 500, 0, north_cm_s, east_cm_s, 0, 65535
    )


def system_time(utc_s=UTC_S):
    return dialect.MAVLink_system_time_message(round(utc_s * 1e6), 10_000)


class Rig:
    """A position driver, its line, and a board that it has selected."""

    def __init__(self, line, **options):
        self.line, self.board = line, Board()
        self.position = MavlinkPosition(line, MavlinkPositionOptions(**options))
        self.fixes(0.0, None, None)

    def fixes(self, now_s, *messages):
        for message in messages:
            self.line.inbox += self.board.heartbeat() if message is None else self.board.pack(message)
        self.position.receive(now_s)
        return self.position.poll()

    def health(self, now_s):
        health = self.position.health(now_s)
        return health.state, health.text


@pytest.fixture
def rig(line):
    return Rig(line)


def test_fix_of_the_receiver(rig):
    (fix,) = rig.fixes(1.0, gps())
    assert (fix.t_s, fix.fix, fix.satellites) == (1.0, FixType.FIX_3D, 14)
    assert math.degrees(fix.latitude_rad) == pytest.approx(36.5)
    assert math.degrees(fix.longitude_rad) == pytest.approx(-121.25)
    assert fix.altitude_m == pytest.approx(12.345)
    assert fix.speed_over_ground_m_s == pytest.approx(0.47)
    assert math.degrees(fix.course_over_ground_rad) == pytest.approx(270.0)
    assert fix.hdop == pytest.approx(0.85)
    assert fix.utc_s is None
    assert rig.health(1.0) == (DeviceState.RUNNING, "")


@pytest.mark.parametrize(
    ("number", "fix_type"),
    [
        (0, FixType.NONE), (1, FixType.NONE), (2, FixType.FIX_2D), (3, FixType.FIX_3D), (4, FixType.DGPS),
        (5, FixType.RTK_FLOAT), (6, FixType.RTK_FIXED), (7, FixType.NONE), (8, FixType.FIX_3D), (9, FixType.NONE),
    ],
)  # fmt: skip
def test_fix_types(rig, number, fix_type):
    (fix,) = rig.fixes(1.0, gps(number))
    assert fix.fix is fix_type
    assert (fix.latitude_rad is None) == (fix_type is FixType.NONE)
    assert rig.health(1.0) == (DeviceState.RUNNING, "no fix" if fix_type is FixType.NONE else "")


def test_unknown_values_are_none(rig):
    (fix,) = rig.fixes(1.0, gps(eph=65535, vel=65535, cog=65535, satellites=255, accuracy_mm=0))
    assert (fix.hdop, fix.speed_over_ground_m_s, fix.course_over_ground_rad, fix.satellites) == (None, None, None, None)
    (fix,) = rig.fixes(2.0, gps(time_us=2, eph=0, cog=36000))
    assert (fix.hdop, fix.course_over_ground_rad) == (None, 0.0)


@pytest.mark.parametrize(("accuracy_mm", "is_fix"), [(50_000, True), (50_001, False)])
def test_inaccurate_fix_is_not_used(rig, accuracy_mm, is_fix):
    (fix,) = rig.fixes(1.0, gps(accuracy_mm=accuracy_mm))
    assert (fix.fix is not FixType.NONE) == is_fix


def test_position_at_zero_is_no_fix(rig):
    (fix,) = rig.fixes(1.0, gps(lat=0.0, lon=0.0))
    assert (fix.fix, fix.latitude_rad, fix.satellites) == (FixType.NONE, None, 14)
    assert rig.health(1.0) == (DeviceState.RUNNING, "position invalid: no fix")


@pytest.mark.parametrize(
    "values",
    [{"lat": 90.5}, {"lat": -90.5}, {"lon": 180.5}, {"lon": -180.5}, {"vel": 20_001}, {"cog": 36_001}],
)
def test_impossible_values_are_rejected(rig, values):
    assert rig.fixes(1.0, gps(**values)) == ()
    assert rig.position.health(1.0).rejected == 1


def test_repeated_measurement_gives_no_sample(rig):
    assert len(rig.fixes(1.0, gps(time_us=7))) == 1
    assert rig.fixes(2.0, gps(time_us=7)) == ()
    assert len(rig.fixes(3.0, gps(time_us=8))) == 1
    assert len(rig.fixes(4.0, gps(time_us=0), gps(time_us=0))) == 2
    assert rig.position.health(4.0).accepted == 4


def test_time_is_extrapolated_for_three_seconds(rig):
    rig.fixes(1.0, system_time())
    assert rig.fixes(1.5, gps(time_us=1))[0].utc_s == pytest.approx(UTC_S + 0.5, abs=1e-5)
    assert rig.fixes(4.0, gps(time_us=2))[0].utc_s == pytest.approx(UTC_S + 3.0, abs=1e-5)
    assert rig.fixes(4.01, gps(time_us=3))[0].utc_s is None


@pytest.mark.parametrize(
    ("utc_s", "is_used"),
    [(0.0, False), (946_684_799.0, False), (946_684_800.0, True), (4_102_444_800.0, True), (4_102_444_801.0, False)],
)
def test_clock_that_is_not_set_is_not_used(rig, utc_s, is_used):
    assert (rig.fixes(1.0, system_time(utc_s), gps())[0].utc_s is not None) == is_used


def test_time_without_a_fix_is_not_used(rig):
    assert rig.fixes(1.0, system_time(), gps(1))[0].utc_s is None


def test_estimator_is_used_while_the_receiver_has_a_fix(line):
    rig = Rig(line, solution="estimator")
    assert rig.fixes(0.9, estimate())[0].fix is FixType.NONE
    (fix,) = rig.fixes(1.0, gps(4), estimate())
    assert (fix.fix, fix.satellites, fix.hdop) == (FixType.DGPS, 14, pytest.approx(0.85))
    assert math.degrees(fix.latitude_rad) == pytest.approx(36.6)
    assert math.degrees(fix.longitude_rad) == pytest.approx(-121.35)
    assert fix.altitude_m == pytest.approx(0.5)
    assert fix.speed_over_ground_m_s == pytest.approx(0.5)
    assert math.degrees(fix.course_over_ground_rad) == pytest.approx(306.8699)
    assert rig.fixes(4.0, estimate())[0].fix is FixType.DGPS
    assert rig.fixes(4.01, estimate())[0].fix is FixType.NONE
    assert rig.fixes(4.2, gps(1, time_us=2), estimate())[0].fix is FixType.NONE
    assert rig.fixes(4.3, gps(3, time_us=3), estimate(lat=91.0)) == ()


@pytest.mark.parametrize(("north_cm_s", "is_used"), [(20_000, True), (20_001, False), (0, True)])
def test_impossible_speed_of_the_estimator_is_rejected(line, north_cm_s, is_used):
    rig = Rig(line, solution="estimator")
    assert len(rig.fixes(1.0, gps(), estimate(north_cm_s=north_cm_s, east_cm_s=0))) == is_used


@pytest.mark.parametrize("values", [{"vel": 20_000}, {"vel": 0}, {"cog": 0}, {"lat": 90.0}, {"lon": -180.0}])
def test_extreme_values_are_used(rig, values):
    assert len(rig.fixes(1.0, gps(**values))) == 1


def test_estimator_is_not_used_by_default(rig):
    assert len(rig.fixes(1.0, gps(), estimate())) == 1


def test_restart_of_the_board_discards_fix_and_time(line):
    rig = Rig(line, solution="estimator")
    rig.fixes(1.0, system_time(), gps(), estimate())
    restarted = dialect.MAVLink_system_time_message(0, 100)
    (fix,) = rig.fixes(1.1, restarted, estimate())
    assert (fix.fix, fix.utc_s) == (FixType.NONE, None)


@pytest.mark.parametrize(
    ("solution", "messages"),
    [
        ("receiver", [(Message.GPS_RAW_INT, 500_000), (Message.SYSTEM_TIME, 1_000_000)]),
        (
            "estimator",
            [
                (Message.GPS_RAW_INT, 500_000),
                (Message.SYSTEM_TIME, 1_000_000),
                (Message.GLOBAL_POSITION_INT, 500_000),
            ],
        ),
    ],
)
def test_requested_messages(line, solution, messages):
    Rig(line, solution=solution, rate_hz=2)
    assert requested(line.written) == messages
    assert {message.get_srcComponent() for message in decode_all(line.written)} == {
        dialect.MAV_COMP_ID_ONBOARD_COMPUTER2
    }


def test_one_fix_a_second_is_the_default(line):
    for options, problem in (({"solution": "both"}, "solution: 'both'"), ({"rate_hz": 11}, "rate_hz: .* 1 to 10$")):
        with pytest.raises(ValueError, match=problem):
            MavlinkPositionOptions(**options)
    Rig(line)
    assert requested(line.written) == [(Message.GPS_RAW_INT, 1_000_000), (Message.SYSTEM_TIME, 1_000_000)]


def test_groups_of_an_older_board(line):
    rig = Rig(line, solution="estimator")
    rig.fixes(
        0.5, dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_RESULT_UNSUPPORTED)
    )
    rig.fixes(1.0)
    assert requested_streams(line.written) == [
        dialect.MAV_DATA_STREAM_EXTENDED_STATUS,
        dialect.MAV_DATA_STREAM_EXTRA3,
        dialect.MAV_DATA_STREAM_POSITION,
    ]


def test_silent_board(rig):
    assert rig.health(0.1) == (DeviceState.STARTING, "connected, no position yet")
    rig.fixes(1.0, gps())
    assert rig.health(6.1)[0] is DeviceState.SILENT
