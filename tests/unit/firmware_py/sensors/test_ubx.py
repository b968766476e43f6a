"""The u-blox driver and its NAV-PVT, against made packets and a recording."""

import datetime as dt
import itertools
import math

import pytest

from firmware_py.common.records import DeviceState, FixType
from firmware_py.sensors.ubx import UbxPosition


@pytest.fixture
def receiver(line):
    return UbxPosition(line)


@pytest.fixture
def hear(line):
    def give(receiver, data, now_s=1.0):
        line.inbox += data
        receiver.receive(now_s)
        return receiver.poll()

    return give


def test_a_solution(line, hear, solution, near):
    (sample,) = hear(UbxPosition(line), solution(), now_s=2.5)
    assert near(sample.latitude_rad, -34.9062263)
    assert near(sample.longitude_rad, 138.6081197)
    assert near(sample.course_over_ground_rad, 90.0)
    assert (sample.t_s, sample.fix, sample.satellites, sample.hdop) == (2.5, FixType.FIX_3D, 14, None)
    assert (sample.speed_over_ground_m_s, sample.altitude_m) == (pytest.approx(0.5), pytest.approx(28.895))
    assert sample.utc_s == dt.datetime(2017, 7, 19, 8, 50, 1, 250_000, dt.UTC).timestamp()


@pytest.mark.parametrize(
    ("fix_type", "flags", "fix"),
    [(0, 0, 1), (0, 1, 1), (1, 1, 1), (2, 1, 2), (3, 1, 3), (4, 1, 3), (5, 1, 1), (9, 1, 1), (3, 0, 1), (3, 3, 4),
     (3, 0x43, 5), (3, 0x83, 6), (3, 0xC1, 3)],
)  # fmt: skip
def test_the_fix(hear, solution, fix_type, flags, fix, receiver):
    (sample,) = hear(receiver, solution(fix_type=fix_type, flags=flags))
    assert sample.fix == fix
    assert (sample.latitude_rad is None) == (fix == FixType.NONE)
    assert receiver.health(1.0).text == ("no fix" if fix == FixType.NONE else "")


@pytest.mark.parametrize(
    "values",
    [{"lat": 900000001}, {"lon": -1800000001}, {"speed": -1}, {"speed": 10**6}, {"course": 36000001}, {"course": -1}],
)  # fmt: skip
def test_values_out_of_range_are_refused(hear, solution, values, receiver):
    assert hear(receiver, solution(**values)) == ()
    assert (receiver.health(1.0).rejected, receiver.health(1.0).accepted) == (1, 0)


@pytest.mark.parametrize(("lat", "lon"), [(0, 0), (900000000, 0)])
def test_a_place_that_cannot_be_is_no_fix(hear, solution, lat, lon, receiver):
    (sample,) = hear(receiver, solution(lat=lat, lon=lon))
    assert (sample.fix, sample.latitude_rad) == (FixType.NONE, None)
    assert receiver.health(1.0).text == "position invalid: no fix"


def test_a_position_that_the_receiver_calls_invalid_beside_a_good_fix_is_none(line, hear, solution):
    samples = hear(UbxPosition(line), solution(flags3=1) + solution(flags3=0xE01E))
    assert [sample.fix for sample in samples] == [FixType.NONE, FixType.FIX_3D]


@pytest.mark.parametrize(("accuracy_mm", "text"), [(50_000, ""), (83_400, "no fix: accuracy 83 m")])
def test_a_fix_of_a_cold_start_or_under_jamming_counts_from_fifty_metres(hear, solution, accuracy_mm, text, receiver):
    (sample,) = hear(receiver, solution(accuracy_mm=accuracy_mm))
    assert (sample.fix is FixType.NONE, sample.latitude_rad is None, sample.satellites) == (bool(text), bool(text), 14)
    assert (receiver.health(1.0).state, receiver.health(1.0).text) == (DeviceState.RUNNING, text)


@pytest.mark.parametrize("stream", [b"$GNRMC,,V,,,,,,,,,,N*4D\r\n", "NAV-STATUS"])
def test_a_receiver_that_sends_anything_but_nav_pvt_is_not_said_to_have_another_baud_rate(hear, ubx, stream, receiver):
    hear(receiver, ubx(0x0103, bytes(16)) if stream == "NAV-STATUS" else stream)
    assert receiver.health(1.0).text == "no NAV-PVT: enable UBX-NAV-PVT in the receiver"


def test_other_messages_short_ones_and_nmea_between(hear, solution, ubx, receiver):
    stream = b"$GPTXT,hello*00\r\n" + ubx(0x0120, bytes(16)) + solution() + b"$GPTXT,hello*00\r\n" + solution()
    assert len(hear(receiver, stream)) == 2
    assert receiver.health(1.0).rejected == 0
    assert hear(receiver, ubx(0x0107, bytes(80))) == ()
    assert receiver.health(1.0).text == "NAV-PVT of 80 bytes"


def test_every_bit_flip_is_refused_and_the_next_packet_found(hear, solution, receiver):
    packet = solution()
    good = hear(receiver, packet)
    for bit in range(8 * len(packet)):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        assert hear(receiver, bytes(damaged) + packet) == good, bit


def test_a_recording(hear, recordings, receiver):
    data = (recordings / "ubx" / "gpsd_ublox-neo-m8n.log").read_bytes()
    samples = [*hear(receiver, data), *hear(receiver, b"")]
    assert len(samples) == data.count(b"\xb5\x62\x01\x07\x5c\x00") == 24
    assert all(sample.fix is FixType.DGPS for sample in samples)
    assert math.degrees(samples[0].latitude_rad) == pytest.approx(-34.9062263)
    steps_s = [second.utc_s - first.utc_s for first, second in itertools.pairwise(samples)]
    assert all(step_s == pytest.approx(0.2, abs=1e-3) for step_s in steps_s)
    assert receiver.health(1.0).state is DeviceState.RUNNING


def test_a_reopened_port_begins_again(line, hear, solution, receiver):
    hear(receiver, solution()[:50])
    line.unplug()
    assert (receiver.fileno(), receiver.health(1.0).state) == (-1, DeviceState.ABSENT)
    line.plug()
    assert hear(receiver, solution()[50:]) == ()
    assert len(hear(receiver, solution())) == 1


@pytest.mark.parametrize(
    "values",
    [
        *({"date": date} for date in ((2017, 2, 30), (1979, 1, 6), (2017, 0, 1))),
        *({"valid": valid} for valid in (0, 1, 2, 3)),  # 3: the leap seconds are unknown
    ],
)
def test_an_invalid_time_is_removed_and_the_position_kept(hear, receiver, solution, values):
    (sample,) = hear(receiver, solution(**values))
    assert (sample.fix, sample.utc_s, sample.latitude_rad is None) == (FixType.FIX_3D, None, False)
