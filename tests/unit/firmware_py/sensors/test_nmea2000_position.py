"""NMEA 2000 receiver: fixes of PGN 129029 and 129025, their quality, time, course and speed, and rejected positions."""

import math

import pytest

from firmware_py.common.records import DeviceState, FixType
from firmware_py.sensors.nmea2000_position import Nmea2000Position
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from hil.devices import nmea2000_frames as n2k

UTC_S = 1_700_000_000.5
PLACE = 50.25, -3.5


@pytest.fixture
def receiver(line):
    return Nmea2000Position(line, Nmea2000Options())


def gnss(*, place=PLACE, utc_s=UTC_S, source=0x10, **quality):
    return n2k.actisense_message(129029, source, n2k.gnss_position(*place, utc_s, **quality))


def rapid(place=PLACE, source=0x10):
    return n2k.actisense_message(129025, source, n2k.position(*place))


def course(course_deg, speed_m_s, reference=n2k.TRUE, source=0x10):
    course_rad = None if course_deg is None else math.radians(course_deg)
    return n2k.actisense_message(129026, source, n2k.course(course_rad, speed_m_s, reference))


def time(utc_s, source=0x10):
    return n2k.actisense_message(126992, source, n2k.system_time(utc_s))


def test_position_time_and_quality(deliver, receiver):
    (fix,) = deliver(receiver, gnss(altitude_m=12.5, satellites=11, hdop=0.8), now_s=2.5)
    assert (math.degrees(fix.latitude_rad), math.degrees(fix.longitude_rad)) == pytest.approx(PLACE, abs=1e-12)
    assert (fix.t_s, fix.fix, fix.satellites, fix.hdop) == (2.5, FixType.FIX_3D, 11, pytest.approx(0.8))
    assert (fix.altitude_m, fix.utc_s) == (pytest.approx(12.5), pytest.approx(UTC_S, abs=1e-3))
    assert (fix.speed_over_ground_m_s, fix.course_over_ground_rad) == (None, None)


@pytest.mark.parametrize(
    ("method", "fix"),
    [(0, "NONE"), (1, "FIX_3D"), (2, "DGPS"), (3, "FIX_3D"), (4, "RTK_FIXED"), (5, "RTK_FLOAT"), (6, "NONE"),
     (7, "NONE"), (8, "NONE"), (15, "NONE")],
)  # fmt: skip
def test_methods(deliver, receiver, method, fix):
    (sample,) = deliver(receiver, gnss(method=method))
    assert sample.fix.name == fix
    assert (sample.latitude_rad is None) is (fix == "NONE")
    assert receiver.health(1.0).text == ("no fix" if fix == "NONE" else "")


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"place": (None, None)}, "no fix"), ({"place": (90.5, 0.0)}, "no fix"), ({"place": (0.0, 180.5)}, "no fix"),
     ({"place": (0.0, 0.0)}, "position invalid: no fix"), ({"integrity": 3}, "integrity unsafe: no fix")],
)  # fmt: skip
def test_positions_that_are_not_used(deliver, receiver, change, reason):
    (sample,) = deliver(receiver, gnss(**change))
    assert (sample.fix, sample.latitude_rad, sample.utc_s) == (FixType.NONE, None, None)
    assert receiver.health(1.0).text == reason
    assert receiver.health(1.0).state is DeviceState.RUNNING
    (sample,) = deliver(receiver, gnss(), now_s=2.0)
    assert (sample.fix, receiver.health(2.0).text) == (FixType.FIX_3D, "")


@pytest.mark.parametrize(
    ("change", "name", "expected"),
    [({"altitude_m": None}, "fix", FixType.FIX_2D), ({"altitude_m": 100_000.5}, "altitude_m", None),
     ({"altitude_m": 1e5}, "altitude_m", 1e5), ({"altitude_m": -1e3}, "altitude_m", -1e3),
     ({"altitude_m": -1000.5}, "altitude_m", None), ({"hdop": 0.0}, "hdop", 0.0),
     ({"utc_s": 315532800.0}, "utc_s", 315532800.0), ({"place": (50.0, None)}, "fix", FixType.NONE),
     ({"place": (None, 50.0)}, "fix", FixType.NONE), ({"place": (0.0, 50.0)}, "latitude_rad", 0.0),
     ({"place": (50.0, 0.0)}, "longitude_rad", 0.0),
     ({"hdop": None}, "hdop", None), ({"hdop": -1.0}, "hdop", None), ({"satellites": 255}, "satellites", None),
     ({"utc_s": None}, "utc_s", None), ({"utc_s": 3e8}, "utc_s", None),
     ({"utc_s": 4102444800.0}, "utc_s", 4102444800.0), ({"utc_s": 4102444801.0}, "utc_s", None),
     ({"integrity": 2}, "fix", FixType.FIX_3D)],
)  # fmt: skip
def test_values_that_are_not_available(deliver, receiver, change, name, expected):
    (sample,) = deliver(receiver, gnss(**change))
    assert getattr(sample, name) == expected
    assert (sample.latitude_rad is None) is (sample.fix is FixType.NONE)


def test_course_and_speed_are_used_while_they_are_recent(deliver, receiver):
    deliver(receiver, gnss(), now_s=0.5)
    (fix,) = deliver(receiver, course(123.0, 1.25), gnss(), now_s=1.0)
    assert math.degrees(fix.course_over_ground_rad) == pytest.approx(123.0, abs=0.01)
    assert fix.speed_over_ground_m_s == pytest.approx(1.25)
    assert deliver(receiver, gnss(), now_s=2.0)[0].speed_over_ground_m_s is not None
    assert deliver(receiver, gnss(), now_s=2.01)[0].speed_over_ground_m_s is None
    (fix,) = deliver(receiver, course(123.0, 1.0, n2k.MAGNETIC), gnss(), now_s=2.2)
    assert (fix.course_over_ground_rad, fix.speed_over_ground_m_s) == (None, pytest.approx(1.0))
    assert deliver(receiver, course(None, 200.0), gnss(), now_s=2.3)[0].speed_over_ground_m_s == 200.0
    (fix,) = deliver(receiver, course(None, 200.01), gnss(), now_s=2.3)
    assert (fix.course_over_ground_rad, fix.speed_over_ground_m_s) == (None, None)


def test_rapid_positions_are_used_only_without_gnss_data(deliver, receiver):
    assert deliver(receiver, rapid(), now_s=1.0) == ()
    assert deliver(receiver, rapid(), now_s=4.0) == ()  # PGN 129029 may follow
    (fix,) = deliver(receiver, rapid(), now_s=4.01)
    assert (fix.fix, fix.altitude_m, fix.utc_s) == (FixType.FIX_2D, None, None)
    assert math.degrees(fix.latitude_rad) == pytest.approx(50.25)
    assert len(deliver(receiver, gnss(), rapid(), now_s=5.0)) == 1
    assert deliver(receiver, rapid(), now_s=8.0) == ()
    assert len(deliver(receiver, rapid(), now_s=8.01)) == 1
    (fix,) = deliver(receiver, rapid((None, None)), now_s=8.02)
    assert fix.fix is FixType.NONE


def test_rapid_positions_do_not_hide_that_there_is_no_fix(deliver, receiver):
    (fix,) = deliver(receiver, gnss(method=0), rapid(), now_s=2.0)
    assert fix.fix is FixType.NONE


def test_time_of_the_system_message_is_used_while_it_is_recent(deliver, receiver):
    deliver(receiver, rapid(), now_s=0.5)
    deliver(receiver, time(UTC_S), now_s=4.0)
    (fix,) = deliver(receiver, rapid(), now_s=6.5)
    assert fix.utc_s == pytest.approx(UTC_S + 2.5, abs=1e-3)
    assert deliver(receiver, rapid(), now_s=6.51)[0].utc_s is None
    (fix,) = deliver(receiver, time(UTC_S + 9.0), gnss(utc_s=UTC_S + 8.0), now_s=7.0)
    assert fix.utc_s == pytest.approx(UTC_S + 8.0, abs=1e-3)
    deliver(receiver, time(None), now_s=7.1)
    assert deliver(receiver, gnss(utc_s=None), now_s=7.2)[0].utc_s is None


def test_date_without_a_time_is_no_time(deliver, receiver):
    data = bytearray(n2k.gnss_position(*PLACE, UTC_S))
    data[3:7] = b"\xff" * 4
    (fix,) = deliver(receiver, n2k.actisense_message(129029, 0x10, bytes(data)))
    assert (fix.fix, fix.utc_s) == (FixType.FIX_3D, None)


def test_hanging_receiver_has_no_fix(deliver, receiver):
    fixes = [deliver(receiver, gnss(), now_s=t_s)[0].fix for t_s in (0.0, 1.0, 2.0, 3.0, 3.01, 5.0)]
    assert fixes == [FixType.FIX_3D] * 4 + [FixType.NONE] * 2
    assert receiver.health(5.0).text == "time not advancing: no fix"
    assert deliver(receiver, gnss(utc_s=UTC_S + 6.0), now_s=6.0)[0].fix is FixType.FIX_3D
    for now_s in (7.0, 11.0):  # a receiver without a time does not hang
        assert deliver(receiver, gnss(utc_s=None), now_s=now_s)[0].fix is FixType.FIX_3D


def test_second_receiver_is_not_mixed_and_takes_over_after_silence(deliver, receiver):
    other = {"place": (51.0, -4.0), "source": 0x15}
    deliver(receiver, gnss(), now_s=1.0)
    assert len(deliver(receiver, gnss(**other), course(10.0, 9.0, source=0x15), gnss(), now_s=2.0)) == 1
    assert receiver.health(2.0).text == "second position source 0x15 not used"
    assert deliver(receiver, gnss(**other), now_s=7.0) == ()
    (fix,) = deliver(receiver, gnss(**other), now_s=7.01)
    assert (math.degrees(fix.latitude_rad), fix.speed_over_ground_m_s) == (pytest.approx(51.0), None)


def test_receiver_with_a_fix_replaces_one_without(deliver, receiver):
    place = {"place": (51.0, -4.0), "source": 0x15}
    assert [fix.fix for fix in deliver(receiver, gnss(method=0, satellites=2), now_s=0.5)] == [FixType.NONE]
    assert (receiver.health(0.5).state, receiver.health(0.5).text) == (DeviceState.RUNNING, "no fix")
    assert [fix.fix for fix in deliver(receiver, gnss(**place), gnss(method=0), now_s=1.0)] == [FixType.FIX_3D]
    assert deliver(receiver, gnss(utc_s=UTC_S + 2.0), now_s=2.0) == ()  # a fix, but the other one is selected
    lost = deliver(receiver, gnss(method=0, **place), gnss(utc_s=UTC_S + 5.0), now_s=6.0)
    assert [fix.fix for fix in lost] == [FixType.NONE]
    (lost, fix) = deliver(receiver, gnss(method=0, **place), gnss(utc_s=UTC_S + 6.0), now_s=6.01)
    assert (lost.fix, fix.fix, math.degrees(fix.latitude_rad)) == (FixType.NONE, FixType.FIX_3D, pytest.approx(50.25))


def test_message_without_a_fix_of_another_than_the_configured_receiver_is_not_reported(line, deliver):
    receiver = Nmea2000Position(line, Nmea2000Options(source=0x15))
    assert deliver(receiver, gnss(method=0)) == ()
    assert len(deliver(receiver, gnss(method=0, source=0x15))) == 1


def test_reopened_line_forgets_the_receiver(line, deliver, receiver):
    deliver(receiver, gnss(), course(1.0, 1.0), now_s=1.0)
    line.openings += 1
    assert deliver(receiver, rapid(), now_s=1.1) == ()
    assert deliver(receiver, rapid(), now_s=4.1) == ()
    (fix,) = deliver(receiver, rapid(), now_s=4.2)
    assert (fix.fix, fix.speed_over_ground_m_s) == (FixType.FIX_2D, None)


def test_values_from_before_the_line_was_reopened_are_not_used(deliver, line, receiver):
    (_, fix) = deliver(receiver, gnss(), time(UTC_S), course(10.0, 1.0), gnss(utc_s=None))
    assert (fix.course_over_ground_rad is None, fix.utc_s is None) == (False, False)
    line.plug()
    (fix,) = deliver(receiver, gnss(utc_s=None), now_s=1.1)
    assert (fix.course_over_ground_rad, fix.speed_over_ground_m_s, fix.utc_s) == (None, None, None)


def test_complete_fixes_are_awaited_from_the_first_message_after_a_reopened_line(deliver, line, receiver):
    deliver(receiver, gnss())
    line.plug()
    deliver(receiver, now_s=1.1)
    assert [len(deliver(receiver, rapid(), now_s=now_s)) for now_s in (10.0, 10.1, 20.0)] == [0, 0, 1]
