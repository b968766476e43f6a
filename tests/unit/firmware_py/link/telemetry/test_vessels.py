"""AIS_VESSEL: one vessel per message, approaching vessels more often."""

import math
from collections import Counter

import msgspec
import pytest

from firmware_py.common.vessels import Traffic, Vessel, VesselIdentity, VesselKind, VesselPosition
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.motion import ais_vessel
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Codec, stamp

CODEC = Codec(1, 1)
SHIP = Vessel(
    VesselPosition(
        2.0, 211000001, VesselKind.CLASS_A, 0.7, -0.2, 5.123, math.radians(359.99), 1.0, -math.radians(2.0), 3, True
    ),
    VesselIdentity(1.0, 211000001, "ANNA OF THE SEVEN SE", "DA12345", 70, (511, 10, 63, 8)),
)
MARK = Vessel(VesselPosition(2.0, 7, VesselKind.MARK, 0.7, -0.2))


@pytest.fixture
def build(snapshot):
    def build_message(t_s, *vessels):
        boat = msgspec.structs.replace(snapshot, t_s=t_s, traffic=Traffic(vessels) if vessels else None)
        message = ais_vessel(TelemetryContext(boat, 1.7e9, 0.5, 3, 0.0, 0))
        return None if message is None else CODEC.decode(stamp(CODEC.pack(message), 0))

    return build_message


def test_fields_have_the_units_of_mavlink(build):
    ship = build(12.4, SHIP)
    latitude, longitude = (round(math.degrees(angle_rad) * 1e7) for angle_rad in (0.7, -0.2))
    assert (ship.MMSI, ship.lat, ship.lon) == (211000001, latitude, longitude)
    assert (ship.COG, ship.heading, ship.velocity, ship.turn_rate) == (35999, round(math.degrees(1.0) * 100), 512, -20)
    assert (ship.navigational_status, ship.type, ship.tslc) == (3, 70, 10)
    assert (ship.dimension_bow, ship.dimension_stern, ship.dimension_port, ship.dimension_starboard) == (511, 10, 63, 8)
    assert (ship.name, ship.callsign) == ("ANNA OF THE SEVEN SE", "DA12345")
    flags = mavlink.AIS_FLAGS_POSITION_ACCURACY | mavlink.AIS_FLAGS_VALID_COG | mavlink.AIS_FLAGS_VALID_VELOCITY
    flags |= mavlink.AIS_FLAGS_VALID_TURN_RATE | mavlink.AIS_FLAGS_VALID_DIMENSIONS | mavlink.AIS_FLAGS_VALID_NAME
    flags |= mavlink.AIS_FLAGS_LARGE_BOW_DIMENSION | mavlink.AIS_FLAGS_LARGE_PORT_DIMENSION
    assert ship.flags == flags | mavlink.AIS_FLAGS_VALID_CALLSIGN


def test_unknown_values_have_the_numbers_for_unknown(build):
    mark = build(3.0, MARK)
    assert (mark.COG, mark.heading, mark.velocity, mark.turn_rate) == (65535, 65535, 65535, 127)
    dimensions = (mark.dimension_bow, mark.dimension_stern, mark.dimension_port, mark.dimension_starboard)
    assert dimensions == (65535, 65535, 255, 255)
    assert (mark.navigational_status, mark.name, mark.callsign, mark.flags) == (15, "", "", 0)


@pytest.mark.parametrize(
    ("turn_deg_s", "speed_m_s", "now_s", "sent"),
    [
        (20.0, 1e9, 1e6, (126, 65534, 65535)), (-20.0, -1.0, 0.0, (-127, 0, 0)),
        (12.64, 655.34, 65_537.4, (126, 65534, 65535)),
        (-12.6, 0.004, 65_536.4, (-126, 0, 65534)), (None, None, 2.4, (127, 65535, 0)),
    ],
)  # fmt: skip
def test_values_of_a_vessel_are_limited(build, turn_deg_s, speed_m_s, now_s, sent):
    turn_rad_s = None if turn_deg_s is None else math.radians(turn_deg_s)
    position = msgspec.structs.replace(SHIP.position, turn_rad_s=turn_rad_s, speed_m_s=speed_m_s)
    ship = build(now_s, msgspec.structs.replace(SHIP, position=position))
    assert (ship.turn_rate, ship.velocity, ship.tslc) == sent


def test_message_is_not_sent_without_vessels(build):
    assert build(1.0) is None


@pytest.mark.parametrize("interval_s", [0.1, 0.25, 1.0, 5.0, 10.0])
@pytest.mark.parametrize("count", [2, 5, 10, 100])
def test_every_interval_reaches_all_vessels_and_approaching_ones_more_often(build, interval_s, count):
    fleet = [
        msgspec.structs.replace(MARK, position=msgspec.structs.replace(MARK.position, mmsi=index + 1))
        for index in range(count)
    ]
    fleet[1] = msgspec.structs.replace(fleet[1], near_s=0.0)
    turns = Counter(build(2.0 + interval_s * turn, *fleet).MMSI for turn in range(12 * count))
    assert set(turns) == set(range(1, count + 1))
    assert turns[2] > 4 * count


def fleet_of(count, **first):
    fleet = [
        msgspec.structs.replace(MARK, position=msgspec.structs.replace(MARK.position, mmsi=number))
        for number in range(count)
    ]
    return [msgspec.structs.replace(fleet[0], **first), *fleet[1:]]


@pytest.mark.parametrize("count", [8, 10])
def test_no_vessel_waits_more_than_13_turns(build, count):
    turns = [build(2.05 + 0.1 * turn, *fleet_of(count)).MMSI for turn in range(600)]
    for start in range(len(turns) - 13):
        assert set(turns[start : start + 13]) == set(range(count))


@pytest.mark.parametrize(
    "first", [{"near_s": 0.0}, {"position": msgspec.structs.replace(MARK.position, mmsi=970000001)}]
)
def test_approaching_vessels_and_distress_beacons_have_40_percent_of_the_turns(build, first):
    turns = [build(2.05 + 0.1 * turn, *fleet_of(100, **first)).MMSI for turn in range(1000)]
    ((_, count),) = Counter(turns).most_common(1)
    assert count == pytest.approx(400 + 6, abs=8)
