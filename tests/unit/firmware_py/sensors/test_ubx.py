"""u-blox driver: packets, NAV-PVT solutions, invalid data, a recording."""

import datetime as dt
import itertools
import math

import pytest

from firmware_py.common.records import DeviceState, FixType
from firmware_py.sensors import ubx_protocol
from firmware_py.sensors.message_error import MALFORMED, MessageError
from firmware_py.sensors.ubx import UbxPosition

NAV_PVT, NAV_STATUS, NAV_TIMEGPS = 0x0107, 0x0103, 0x0120  # class and id


@pytest.fixture
def receiver(line):
    return UbxPosition(line)


def test_poll_packet_of_the_protocol_description_is_decoded(ubx):
    poll = bytes.fromhex("b562010700000819")
    assert ubx(NAV_PVT, b"") == poll
    (packet,) = ubx_protocol.create_framer().feed(poll)
    assert (packet.fault, ubx_protocol.message_id(packet.data), ubx_protocol.payload(packet.data)) == ("", NAV_PVT, b"")


def test_nav_pvt_of_84_bytes_is_accepted_and_a_shorter_one_rejected(solution):
    payload = ubx_protocol.payload(solution())
    reserved = payload[:78] + b"\x01" + payload[79:84]  # the flag of later models
    assert ubx_protocol.parse_nav_pvt(reserved) == ubx_protocol.parse_nav_pvt(payload)
    with pytest.raises(MessageError) as rejected:
        ubx_protocol.parse_nav_pvt(payload[:83])
    assert rejected.value.error == MALFORMED


def test_solution_is_converted_to_a_sample(deliver, receiver, solution, near):
    (sample,) = deliver(receiver, solution(), now_s=2.5)
    assert near(sample.latitude_rad, -34.9062263)
    assert near(sample.longitude_rad, 138.6081197)
    assert near(sample.course_over_ground_rad, 90.0)
    assert (sample.t_s, sample.fix, sample.satellites, sample.hdop) == (2.5, FixType.FIX_3D, 14, None)
    assert (sample.speed_over_ground_m_s, sample.altitude_m) == (pytest.approx(0.5), pytest.approx(28.895))
    assert sample.utc_s == dt.datetime(2017, 7, 19, 8, 50, 1, 250_000, dt.UTC).timestamp()


@pytest.mark.parametrize(
    # Flags: 1 valid fix, 2 differential correction, 0x40 carrier phase float, 0x80 carrier phase fixed, 0xC0 undefined.
    ("fix_type", "flags", "expected_fix"),
    [(0, 0, "NONE"), (0, 1, "NONE"), (1, 1, "NONE"), (2, 1, "FIX_2D"), (3, 1, "FIX_3D"), (4, 1, "FIX_3D"),
     (5, 1, "NONE"), (9, 1, "NONE"), (3, 0, "NONE"), (3, 3, "DGPS"), (3, 0x43, "RTK_FLOAT"), (3, 0x83, "RTK_FIXED"),
     (3, 0xC1, "FIX_3D")],
)  # fmt: skip
def test_fix_type_and_flags_determine_the_fix(deliver, solution, fix_type, flags, expected_fix, receiver):
    (sample,) = deliver(receiver, solution(fix_type=fix_type, flags=flags))
    assert sample.fix.name == expected_fix
    assert (sample.latitude_rad is None) == (expected_fix == "NONE")
    assert receiver.health(1.0).text == ("no fix" if expected_fix == "NONE" else "")


@pytest.mark.parametrize(
    "values",
    [{"lat": 900000001}, {"lat": -900000001}, {"lon": 1800000001}, {"lon": -1800000001}, {"altitude_mm": -1_000_001},
     {"altitude_mm": 100_000_001}, {"speed": -1}, {"speed": 200_001}, {"course": 36000001}, {"course": -1}],
)  # fmt: skip
def test_values_out_of_range_are_rejected(deliver, solution, values, receiver):
    assert deliver(receiver, solution(**values)) == ()
    assert (receiver.health(1.0).rejected, receiver.health(1.0).accepted) == (1, 0)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"lat": 0, "lon": 0}, "position invalid: no fix"),
        ({"lat": 900000000, "lon": 0}, "position invalid: no fix"),
        ({"lat": -900000000, "lon": 0}, "position invalid: no fix"),
        ({"flags3": 1}, "no fix"),  # marked as invalid by the receiver
        ({"flags3": 0xE01E}, ""),
        ({"accuracy_mm": 50_000}, ""),
        ({"accuracy_mm": 50_001}, "no fix: accuracy 50 m"),
        ({"lat": 0}, ""),
        ({"lon": 0}, ""),
    ],
)
def test_impossible_invalid_or_inaccurate_position_is_no_fix(deliver, solution, values, text, receiver):
    (sample,) = deliver(receiver, solution(**values))
    assert (sample.fix is FixType.NONE, sample.latitude_rad is None, sample.satellites) == (bool(text), bool(text), 14)
    assert (receiver.health(1.0).state, receiver.health(1.0).text) == (DeviceState.RUNNING, text)


@pytest.mark.parametrize(
    "values",
    [
        *({"date": date} for date in ((2017, 2, 30), (1979, 12, 31), (2100, 1, 1), (2017, 0, 1))),
        *({"time": time} for time in ((24, 0, 0), (0, 60, 0), (0, 0, 61))),
        *({"nanosecond": nanosecond} for nanosecond in (-1_000_000_001, 1_000_000_001)),
        *({"valid": valid} for valid in (0, 1, 2, 3)),  # 3: the leap seconds are unknown
    ],
)
def test_invalid_time_is_removed_and_the_position_kept(deliver, receiver, solution, values):
    (sample,) = deliver(receiver, solution(**values))
    assert (sample.fix, sample.utc_s, sample.latitude_rad is None) == (FixType.FIX_3D, None, False)


@pytest.mark.parametrize(
    ("date", "time", "nanosecond", "utc_s"),
    [((1980, 1, 1), (0, 0, 0), 10**9, 315_532_801.0), ((2099, 12, 31), (23, 59, 60), -(10**9), 4_102_444_799.0)],
)
def test_limits_of_the_time_are_accepted(deliver, receiver, solution, date, time, nanosecond, utc_s):
    (sample,) = deliver(receiver, solution(date=date, time=time, nanosecond=nanosecond))
    assert sample.utc_s == utc_s


@pytest.mark.parametrize(
    "values",
    [{"lon": -1800000000}, {"lon": 1800000000}, {"altitude_mm": 100_000_000}, {"altitude_mm": -1_000_000},
     {"speed": 0, "course": 0}, {"speed": 200_000, "course": 35999999}],
)  # fmt: skip
def test_limits_of_the_values_are_accepted(deliver, receiver, solution, values):
    (sample,) = deliver(receiver, solution(**values))
    assert sample.fix is FixType.FIX_3D


@pytest.mark.parametrize("kind", ["NMEA", "NAV-STATUS"])
def test_receiver_without_nav_pvt_is_reported(deliver, ubx, kind, receiver):
    deliver(receiver, ubx(NAV_STATUS, bytes(16)) if kind == "NAV-STATUS" else b"$GNRMC,,V,,,,,,,,,,N*4D\r\n")
    assert receiver.health(1.0).text == "no NAV-PVT: enable UBX-NAV-PVT in the receiver"


def test_other_messages_are_ignored_and_short_nav_pvt_rejected(deliver, solution, ubx, receiver):
    nmea_text = b"$GPTXT,hello*00\r\n"
    assert len(deliver(receiver, nmea_text, ubx(NAV_TIMEGPS, bytes(16)), solution(), nmea_text, solution())) == 2
    assert receiver.health(1.0).rejected == 0
    assert deliver(receiver, ubx(NAV_PVT, bytes(80))) == ()
    assert receiver.health(1.0).text == "NAV-PVT of 80 bytes"


def test_packet_with_one_wrong_bit_is_rejected_and_the_next_packet_decoded(deliver, solution, receiver):
    packet = solution()
    samples = deliver(receiver, packet)
    for bit in range(8 * len(packet)):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        assert deliver(receiver, bytes(damaged), packet) == samples, bit
    damaged_headers = 20  # 16 bits of the marker, 4 that make the length impossible
    assert receiver.health(1.0).rejected == 8 * len(packet) - damaged_headers
    assert receiver.health(1.0).text == "checksum"


def test_recording_of_a_neo_m8n_is_decoded_completely(deliver, recordings, receiver):
    data = (recordings / "ubx" / "gpsd_ublox-neo-m8n.log").read_bytes()
    samples = [*deliver(receiver, data), *deliver(receiver)]
    assert len(samples) == data.count(b"\xb5\x62\x01\x07\x5c\x00") == 24
    assert all(sample.fix is FixType.DGPS for sample in samples)
    assert samples[0].satellites == 14
    assert math.degrees(samples[0].latitude_rad) == pytest.approx(-34.9062263)
    assert math.degrees(samples[0].longitude_rad) == pytest.approx(138.6081197)
    intervals_s = [later.utc_s - earlier.utc_s for earlier, later in itertools.pairwise(samples)]
    assert intervals_s == pytest.approx([0.2] * 23, abs=1e-3)
    assert receiver.health(1.0).state is DeviceState.RUNNING


def test_reopened_port_discards_the_incomplete_packet(line, deliver, solution, receiver):
    deliver(receiver, solution()[:50])
    line.unplug()
    assert (receiver.fileno(), receiver.health(1.0).state) == (-1, DeviceState.ABSENT)
    line.plug()
    assert deliver(receiver, solution()[50:]) == ()
    assert len(deliver(receiver, solution())) == 1
