"""WIND_COV, WATER_DEPTH and the wind of HIGH_LATENCY2, decoded by pymavlink's own definitions."""

import math

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from firmware_py.common.records import DepthSample, FixType, PositionSample
from firmware_py.common.reports import Wind
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.table import TABLE
from firmware_py.link.wire.frames import Codec, stamp

CODEC = Codec(1, 1)
WIND = Wind(
    99.5, 6.0, 0.5, north_m_s=-3.0, east_m_s=4.0, wind_m_s=5.1, from_rad=5.3, mean_m_s=4.4, mean_from_rad=math.pi / 2,
    sd_m_s=0.7, gust_m_s=8.0,
)  # fmt: skip
FIX = PositionSample(0.0, FixType.FIX_3D, math.radians(40.0), math.radians(-10.0))


@pytest.fixture
def decode(snapshot):
    """Function that builds a message of the table and decodes it with pymavlink."""

    def decode_message(name, **changes):
        boat = msgspec.structs.replace(snapshot, **changes)
        (row,) = (row for row in TABLE if row.name == name)
        message = row.build(TelemetryContext(boat, 1.7e9, 0.5, 3, 0.0, 0))
        if message is None:
            return None
        (decoded,) = ardupilotmega.MAVLink(None).parse_buffer(bytes(stamp(CODEC.pack(message), 0)))
        return decoded

    return decode_message


def test_wind_cov_is_the_velocity_of_the_air(decode):
    message = decode("WIND_COV", wind=WIND, wind_ok=True)
    assert (message.get_type(), message.time_usec) == ("WIND_COV", 99_500_000)
    assert (message.wind_x, message.wind_y) == (-3.0, 4.0)
    assert message.var_horiz == pytest.approx(0.7)
    unknown = (message.wind_z, message.var_vert, message.wind_alt, message.horiz_accuracy, message.vert_accuracy)
    assert all(math.isnan(value) for value in unknown)


def test_wind_cov_is_sent_only_with_a_recent_wind_over_the_ground(decode):
    assert decode("WIND_COV") is None
    assert decode("WIND_COV", wind=WIND, wind_ok=False) is None
    assert decode("WIND_COV", wind=Wind(1.0, 6.0, 0.5), wind_ok=True) is None
    assert math.isnan(decode("WIND_COV", wind=msgspec.structs.replace(WIND, sd_m_s=None), wind_ok=True).var_horiz)


def test_water_depth_is_that_below_the_transducer(decode):
    boat = {"position": FIX, "position_ok": True, "roll_rad": 0.1, "pitch_rad": -0.2, "heading_rad": 1.0}
    message = decode("WATER_DEPTH", depth=DepthSample(99.5, 12.0, 0.5), depth_ok=True, heading_ok=True, **boat)
    assert (message.get_type(), message.time_boot_ms, message.id, message.healthy) == ("WATER_DEPTH", 99_500, 0, 1)
    assert (message.lat, message.lng, message.distance) == (400_000_000, -100_000_000, 11.5)
    assert (message.roll, message.pitch, message.yaw) == pytest.approx((0.1, -0.2, 1.0))
    assert (message.alt, math.isnan(message.temperature)) == (0.0, True)


def test_water_depth_is_not_healthy_when_old_and_absent_before_the_first(decode):
    assert decode("WATER_DEPTH") is None
    old = decode("WATER_DEPTH", depth=DepthSample(99.5, 0.2, 0.5), depth_ok=False, heading_ok=False)
    assert (old.healthy, old.distance, old.yaw) == (0, 0.0, 0.0)


def test_satellite_report_has_the_mean_wind(decode):
    message = decode("HIGH_LATENCY2", wind=WIND, wind_ok=True)
    assert (message.windspeed, message.wind_heading) == (22, 45)
    for changes in ({}, {"wind": WIND, "wind_ok": False}, {"wind": Wind(1.0), "wind_ok": True}):
        message = decode("HIGH_LATENCY2", **changes)
        assert (message.windspeed, message.wind_heading) == (0, 0)


def test_rates_are_those_of_the_neighbours():
    rates = {row.name: (row.fast_hz, row.radio_hz, row.stream) for row in TABLE}
    assert rates["WIND_COV"] == rates["WATER_DEPTH"] == rates["BATTERY_STATUS"]
