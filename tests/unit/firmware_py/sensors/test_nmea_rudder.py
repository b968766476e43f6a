"""Rudder angle sensor: RSA with status, offset and scale."""

import math

import pytest

from firmware_py.common.options import record_from
from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.sensors.nmea_rudder import NmeaRudder, NmeaRudderOptions


@pytest.fixture
def sensor(line):
    return NmeaRudder(line, NmeaRudderOptions())


@pytest.mark.parametrize("body", ["IIRSA,10.5,A,,V", "AGRSA,10.5,A", "IIRSA,10.5,A,-3.0,A"])
def test_starboard_or_only_rudder_is_used(deliver, sensor, body):
    (sample,) = deliver(sensor, body, now_s=2.0)
    assert (sample.t_s, math.degrees(sample.rudder_rad)) == (2.0, pytest.approx(10.5))
    health = sensor.health(2.0)
    assert (health.role, health.state, health.accepted) == (DeviceRole.RUDDER_ANGLE, DeviceState.RUNNING, 1)


@pytest.mark.parametrize("body", ["IIRSA,10.5,V,,V", "IIRSA,,V,-3.0,A", "IIRSA,,A,,", "IIRSA,10.5,"])
def test_invalid_angle_is_not_used(deliver, sensor, body):
    assert deliver(sensor, body) == ()
    assert sensor.health(1.0).text == "IIRSA: no valid rudder angle"
    assert sensor.health(1.0).accepted == 0
    assert len(deliver(sensor, "IIRSA,1.0,A", now_s=1.1)) == 1
    assert sensor.health(1.1).text == ""


@pytest.mark.parametrize(
    ("values", "reading_deg", "rudder_deg"),
    [
        ({"offset_deg": 3.0}, 10.0, 7.0),
        ({"offset_deg": -3.0}, 10.0, 13.0),
        ({"scale": 0.5}, 10.0, 5.0),
        ({"offset_deg": 4.0, "scale": -2.0}, 10.0, -12.0),
    ],
)
def test_calibration(line, deliver, values, reading_deg, rudder_deg):
    sensor = NmeaRudder(line, record_from(NmeaRudderOptions, values))
    (sample,) = deliver(sensor, f"IIRSA,{reading_deg},A")
    assert math.degrees(sample.rudder_rad) == pytest.approx(rudder_deg)


def test_angle_beyond_90_deg_after_the_calibration_is_rejected(line, deliver):
    sensor = NmeaRudder(line, NmeaRudderOptions(scale=3.0))
    assert deliver(sensor, "IIRSA,31.0,A") == ()
    health = sensor.health(1.0)
    assert (health.rejected, health.text) == (1, "IIRSA: 93 deg after offset and scale")
    assert len(deliver(sensor, "IIRSA,-30.0,A", now_s=20.0)) == 1


def test_damaged_and_other_sentences_are_not_used(deliver, sensor):
    assert deliver(sensor, b"$IIRSA,10.5,A,,V*00\r\n", "IIRSA,95.0,A", "HEHDT,10.0,T") == ()
    assert sensor.health(1.0).rejected == 2


def test_checksum_may_be_missing_if_allowed(line, deliver, sensor):
    assert deliver(sensor, b"$IIRSA,10.5,A\r\n") == ()
    assert len(deliver(NmeaRudder(line, NmeaRudderOptions(require_checksum=False)), b"$IIRSA,10.5,A\r\n")) == 1


def test_silence_and_another_opening_of_the_port(deliver, sensor, line):
    deliver(sensor, "IIRSA,1.0,A", now_s=1.0)
    assert sensor.health(4.0).state is DeviceState.SILENT
    line.inbox += b"$IIRSA,5"
    sensor.receive(5.0)
    line.unplug()
    assert sensor.health(5.0).state is DeviceState.ABSENT
    line.plug()
    assert len(deliver(sensor, "IIRSA,1.0,A", now_s=6.0)) == 1
    assert sensor.health(6.0).rejected == 0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"scale": 0.0}, "scale: 0 is not a scale"),
        ({"scale": 11.0}, "scale: 11 is out of range; allowed: -10 to 10"),
        ({"scale": -10.1}, "scale: -10.1 is out of range; allowed: -10 to 10"),
        ({"offset_deg": -90.1}, "offset_deg: -90.1 is out of range; allowed: -90 to 90"),
        ({"offset_deg": 91.0}, "offset_deg: 91 is out of range; allowed: -90 to 90"),
    ],
)
def test_options_out_of_range_are_refused(values, text):
    for make in (record_from, lambda kind, values: kind(**values)):
        with pytest.raises(ValueError, match=text):
            make(NmeaRudderOptions, values)
