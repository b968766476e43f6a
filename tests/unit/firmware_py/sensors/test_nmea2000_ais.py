"""AIS by NMEA 2000: positions and static data, values that are not available, the boat itself, other receivers."""

import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.sensors.nmea2000_ais import Nmea2000Ais, Nmea2000AisOptions
from hil.devices import nmea2000_frames as n2k

MMSI = 211000001


@pytest.fixture
def ais(line):
    return Nmea2000Ais(line, Nmea2000AisOptions())


def message(pgn, data, source=0x40):
    return n2k.actisense_message(pgn, source, data)


def class_a(mmsi=MMSI, place=(50.25, -3.5), speed_m_s=5.0, course_deg=45.0, source=0x40, **values):
    course_rad = None if course_deg is None else math.radians(course_deg)
    return message(129038, n2k.vessel_a(mmsi, *place, speed_m_s, course_rad, **values), source)


def test_position_of_class_a(deliver, ais):
    data = class_a(heading_rad=math.radians(50.0), turn_rad_s=-0.01, status=8)
    (report,) = deliver(ais, data, now_s=2.5)
    assert isinstance(report, VesselPosition)
    assert (report.t_s, report.mmsi, report.kind, report.status, report.accurate) == (
        2.5,
        MMSI,
        VesselKind.CLASS_A,
        8,
        True,
    )
    assert [math.degrees(angle) for angle in (report.latitude_rad, report.longitude_rad)] == pytest.approx(
        [50.25, -3.5]
    )
    assert [math.degrees(report.course_rad), math.degrees(report.heading_rad)] == pytest.approx([45.0, 50.0], abs=0.01)
    assert (report.speed_m_s, report.turn_rad_s) == (pytest.approx(5.0), pytest.approx(-0.01, abs=2e-5))
    health = ais.health(2.5)
    assert (health.role, health.state, health.accepted) == (DeviceRole.AIS, DeviceState.RUNNING, 1)
    assert ais.fileno() == -1
    assert ais.health(602.5).state is DeviceState.RUNNING
    assert ais.health(602.51).state is DeviceState.SILENT


def test_position_of_class_b(deliver, ais):
    (report,) = deliver(ais, message(129039, n2k.vessel_b(MMSI, 50.25, -3.5, 2.0, 1.0)))
    assert (report.kind, report.heading_rad, report.turn_rad_s, report.status) == (VesselKind.CLASS_B, None, None, 15)


def test_values_that_are_not_available_or_impossible(deliver, ais):
    (report,) = deliver(ais, class_a(speed_m_s=None, course_deg=None))
    assert (report.speed_m_s, report.course_rad, report.heading_rad, report.turn_rad_s, report.status) == (
        None,
    ) * 4 + (15,)
    (report,) = deliver(ais, class_a(speed_m_s=52.8, turn_rad_s=0.22))
    assert (report.speed_m_s, report.turn_rad_s) == (None, None)
    (report,) = deliver(ais, class_a(speed_m_s=52.7, turn_rad_s=0.2))
    assert (report.speed_m_s, report.turn_rad_s) == (pytest.approx(52.7), pytest.approx(0.2, abs=2e-5))


@pytest.mark.parametrize("place", [(None, None), (91.0, 0.0), (0.0, 181.0)])
def test_position_report_without_a_position(deliver, ais, place):
    assert deliver(ais, class_a(place=place)) == ()
    (report,) = deliver(ais, class_a(mmsi=970123456, place=place))  # a distress beacon
    assert report == VesselIdentity(1.0, 970123456)


@pytest.mark.parametrize("mmsi", [0, 1_000_000_000])
def test_invalid_mmsi_is_rejected(deliver, ais, mmsi):
    assert deliver(ais, class_a(mmsi=mmsi)) == ()
    assert (ais.health(1.0).rejected, ais.health(1.0).text) == (1, "MMSI is invalid")


def test_static_data_of_class_a(deliver, ais):
    data = n2k.static_a(MMSI, "EVER SAFE", "ABCD1", 70, (100.0, 20.0, 8.0, 30.0))
    (report,) = deliver(ais, message(129794, data))
    assert report == VesselIdentity(1.0, MMSI, "EVER SAFE", "ABCD1", 70, (30, 70, 12, 8))


@pytest.mark.parametrize(
    ("sizes_m", "expected"),
    [((0.0, 0.0, 0.0, 0.0), None), ((10.0, 3.0, 4.0, 1.0), None), ((10.0, 3.0, 1.0, 11.0), None),
     ((10.0, 3.0, 1.0, 10.0), (10, 0, 2, 1)), ((1022.0, 126.0, 126.0, 1022.0), (1022, 0, 0, 126)),
     ((0.0, 3.0, 1.0, 0.0), (0, 0, 2, 1)), ((10.0, 0.0, 0.0, 4.0), (4, 6, 0, 0)), ((None, 3.0, 1.0, 0.0), None),
     ((10.0, None, 1.0, 0.0), None), ((10.0, 3.0, None, None), (0, 10, 3, 0)),
     ((1023.0, 3.0, 1.0, 10.0), None), ((10.0, 127.0, 1.0, 10.0), None)],
)  # fmt: skip
def test_impossible_dimensions_are_unknown(deliver, ais, sizes_m, expected):
    (report,) = deliver(ais, message(129794, n2k.static_a(MMSI, "A", "", 0, sizes_m)))
    assert report.dimensions_m == expected


@pytest.mark.parametrize(
    ("name", "call_sign", "ship_type", "sizes_m"),
    [("A", "", 0, (0, 0, 0, 0)), ("", "B", 0, (0, 0, 0, 0)), ("", "", 70, (0, 0, 0, 0)), ("", "", 0, (9, 3, 1, 1))],
)
def test_static_data_with_one_value(deliver, ais, name, call_sign, ship_type, sizes_m):
    (report,) = deliver(ais, message(129794, n2k.static_a(MMSI, name, call_sign, ship_type, sizes_m)))
    assert (report.name, report.call_sign, report.ship_type) == (name, call_sign, ship_type)


def test_static_data_of_class_b_are_merged(deliver, ais):
    part_a = bytes([24]) + MMSI.to_bytes(4, "little") + b"WITTE RAAF@@@@@@@@@@" + b"\xe0\xff"
    part_b = bytes([24]) + MMSI.to_bytes(4, "little") + b"\x24" + b"SRTEQ#-" + b"DD7558@"
    part_b += bytes.fromhex("82 00 28 00 0A 00 64 00 00 00 00 00 03 E0 FF")
    (report,) = deliver(ais, message(129809, part_a), message(129810, part_b))
    assert report == VesselIdentity(1.0, MMSI, "WITTE RAAF", "DD7558", 36, (10, 3, 3, 1))
    assert deliver(ais, message(129809, part_a[:5] + b"@" * 20 + b"\xe0\xff")) == ()
    craft = part_b[:1] + (982110001).to_bytes(4, "little") + part_b[5:]
    assert deliver(ais, message(129810, craft))[0].dimensions_m is None


# Sent on channel A or B, or own information that is not sent.
@pytest.mark.parametrize("transceiver", [2, 3, 4])
def test_boat_itself_is_no_vessel_and_gives_its_mmsi(deliver, ais, transceiver):
    assert deliver(ais, class_a(transceiver=transceiver)) == ()
    assert ais.health(1.0).accepted == 1
    assert deliver(ais, class_a()) == ()
    assert ais.health(1.0).text == "another station uses the boat's MMSI 211000001"


def test_configured_mmsi_is_not_replaced(line, deliver):
    ais = Nmea2000Ais(line, Nmea2000AisOptions(own_mmsi=235000007))
    assert deliver(ais, class_a(transceiver=2)) == ()
    assert len(deliver(ais, class_a())) == 1
    assert deliver(ais, class_a(mmsi=235000007)) == ()


def test_second_receiver_is_not_used_before_the_first_is_silent(deliver, ais):
    deliver(ais, class_a(), now_s=1.0)
    assert deliver(ais, class_a(source=0x41), now_s=61.0) == ()
    assert ais.health(61.0).text == "second AIS source 0x41 not used"
    assert len(deliver(ais, class_a(source=0x41), now_s=61.01)) == 1


def test_reports_are_taken_in_limited_numbers_with_positions_first(deliver, ais):
    static = [message(129794, n2k.static_a(MMSI + number, "A", "", 70, (0, 0, 0, 0))) for number in range(30)]
    reports = deliver(ais, *static, *(class_a(mmsi=MMSI + number) for number in range(30)))
    assert len(reports) == 40
    assert [type(report) for report in reports[:10]] == [VesselPosition] * 10
    assert len(ais.poll()) == 20
    assert ais.poll() == ()


def test_full_queue_is_reported(line, ais):
    for number in range(300):
        line.inbox += class_a(mmsi=MMSI + number)
        ais.receive(number * 0.1)
    assert ais.health(30.0).text == "too many vessels, some dropped"
    assert ais.health(30.0).rejected == 300 - 256
