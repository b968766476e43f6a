"""Rudder angle sensor, wind sensor and echo sounder on an NMEA 2000 bus."""

import math

import pytest

from firmware_py.common.records import DeviceRole, DeviceState, WindReference
from firmware_py.sensors.nmea2000_depth import Nmea2000Depth, Nmea2000DepthOptions
from firmware_py.sensors.nmea2000_rudder import Nmea2000Rudder, Nmea2000RudderOptions
from firmware_py.sensors.nmea2000_wind import Nmea2000Wind, Nmea2000WindOptions
from hil.devices import nmea2000_frames as n2k

NORTH, MAGNETIC, APPARENT, BOW, BOW_WATER = range(5)


@pytest.fixture
def make(line):
    """Function that makes a driver of a section with options."""
    drivers = {
        "rudder": (Nmea2000Rudder, Nmea2000RudderOptions),
        "wind": (Nmea2000Wind, Nmea2000WindOptions),
        "depth": (Nmea2000Depth, Nmea2000DepthOptions),
    }

    def make(section, **options):
        driver, record = drivers[section]
        return driver(line, record(**options))

    return make


def rudder(angle_deg, instance=0, source=0x30):
    return n2k.actisense_message(
        127245, source, n2k.rudder(None if angle_deg is None else math.radians(angle_deg), instance)
    )


def wind(speed_m_s, angle_deg, reference=APPARENT, source=0x40):
    return n2k.actisense_message(
        130306, source, n2k.wind(speed_m_s, None if angle_deg is None else math.radians(angle_deg), reference)
    )


def depth(depth_m, offset_m=None, source=0x50):
    return n2k.actisense_message(128267, source, n2k.depth(depth_m, offset_m))


def angles_deg(samples):
    return [round(math.degrees(sample.rudder_rad), 1) for sample in samples]


def test_rudder_angle(deliver, make):
    sensor = make("rudder")
    (sample,) = deliver(sensor, rudder(-12.5), now_s=2.5)
    assert (sample.t_s, angles_deg([sample])) == (2.5, [-12.5])
    health = sensor.health(2.5)
    assert (health.role, health.state, health.accepted) == (DeviceRole.RUDDER_ANGLE, DeviceState.RUNNING, 1)
    assert sensor.fileno() == 7


def test_rudder_messages_without_a_position_are_not_used(deliver, make):
    """As canboat recorded them: the autopilot repeats its order, without a position, with another instance."""
    sensor = make("rudder")
    assert deliver(sensor, bytes.fromhex("1002931302 0df101ffccb45d0a0008fcf8230aff7fffffce1003")) == ()
    assert sensor.health(1.0).state is DeviceState.STARTING
    samples = deliver(sensor, bytes.fromhex("10029313020df101ffccb35d0a000800ff230afa09ffff3f1003"))
    assert angles_deg(samples) == [14.6]


def test_text_of_a_device_that_sends_no_angle(deliver, make):
    sensor = make("rudder")
    deliver(sensor, rudder(1.0))
    deliver(sensor, rudder(None), now_s=9.0)
    assert (sensor.health(9.0).state, sensor.health(9.0).text) == (
        DeviceState.SILENT,
        "no rudder angle from the device",
    )
    deliver(sensor, rudder(1.0), now_s=9.1)
    assert sensor.health(9.1).text == ""


@pytest.mark.parametrize(
    ("section", "invalid", "valid"),
    [("wind", wind(None, 1.0), wind(1.0, 1.0)), ("depth", depth(0), depth(1.0))],
)
def test_text_ends_with_the_next_valid_message(deliver, make, section, invalid, valid):
    sensor = make(section)
    deliver(sensor, valid)
    deliver(sensor, invalid)
    assert sensor.health(1.0).text
    deliver(sensor, valid)
    assert sensor.health(1.0).text == ""


@pytest.mark.parametrize("section", ["rudder", "wind", "depth"])
def test_options_of_the_bus_are_checked_in_every_section(make, section):
    for options in ({"source": 252}, {"gateway": "nmea"}):
        with pytest.raises(ValueError, match=next(iter(options))):
            make(section, **options)


@pytest.mark.parametrize(("section", "message"), [("wind", "wind"), ("depth", "depth")])
def test_silence_and_a_second_device(deliver, make, section, message):
    sensor = make(section)
    messages = {"wind": (wind(1.0, 1.0), wind(2.0, 1.0, source=0x41)), "depth": (depth(1.0), depth(2.0, source=0x51))}
    first, second = messages[message]
    deliver(sensor, first, now_s=0.0)
    assert sensor.health(5.0).state is DeviceState.RUNNING
    assert sensor.health(5.01).state is DeviceState.SILENT
    assert deliver(sensor, second, now_s=5.0) == ()
    assert len(deliver(sensor, second, now_s=5.01)) == 1


def test_one_of_several_rudders(deliver, make):
    sensor = make("rudder")
    assert angles_deg(deliver(sensor, rudder(1.0, 3), rudder(2.0, 0), rudder(3.0, 3))) == [1.0, 3.0]
    assert deliver(sensor, rudder(5.0, 0, source=0x31), now_s=4.0) == ()
    assert angles_deg(deliver(sensor, rudder(5.0, 0, source=0x31), now_s=4.01)) == [5.0]
    sensor = make("rudder", instance=0)
    assert angles_deg(deliver(sensor, rudder(1.0, 3), rudder(2.0, 0))) == [2.0]


def test_calibration_of_the_rudder_sensor(deliver, make):
    sensor = make("rudder", offset_deg=5.0, scale=-2.0)
    assert angles_deg(deliver(sensor, rudder(15.0))) == [-20.0]
    for angle_deg in (50.1, -40.1):
        assert deliver(sensor, rudder(angle_deg)) == ()
        assert sensor.health(1.0).text.startswith("rudder_deg after offset and scale")
    assert angles_deg(deliver(sensor, rudder(-39.9), rudder(49.9))) == [89.8, -89.8]
    with pytest.raises(ValueError, match="0 is not a scale"):
        make("rudder", scale=0.0)


@pytest.mark.parametrize("reference", range(5))
def test_wind_and_its_reference(deliver, make, reference):
    sensor = make("wind", offset_deg=-20.0)
    (sample,) = deliver(sensor, wind(7.5, 10.0, reference), now_s=2.5)
    is_from_bow = reference not in (NORTH, MAGNETIC)
    assert (sample.t_s, sample.wind_m_s, sample.reference) == (2.5, 7.5, WindReference(reference))
    assert math.degrees(sample.angle_rad) == pytest.approx(350.0 if is_from_bow else 10.0, abs=0.01)
    assert (sensor.health(2.5).role, sensor.health(2.5).accepted) == (DeviceRole.WIND, 1)


@pytest.mark.parametrize(
    ("speed_m_s", "angle_deg", "reference"),
    [(None, 1.0, APPARENT), (1.0, None, APPARENT), (1.0, 1.0, 5), (1.0, 1.0, 7)],
)
def test_wind_that_is_not_available(deliver, make, speed_m_s, angle_deg, reference):
    sensor = make("wind")
    assert deliver(sensor, wind(speed_m_s, angle_deg, reference)) == ()
    deliver(sensor, wind(1.0, 1.0))
    assert deliver(sensor, wind(speed_m_s, angle_deg, reference), now_s=1.1) == ()
    assert (sensor.health(1.1).text, sensor.health(1.1).accepted) == ("no wind from the device", 3)


def test_impossible_wind_is_rejected(deliver, make):
    sensor = make("wind")
    assert deliver(sensor, wind(120.1, 1.0)) == ()
    assert sensor.health(1.0).text == "wind_speed_m_s 120.1 out of range"
    assert len(deliver(sensor, wind(120.0, 1.0), wind(0.0, 1.0))) == 2


def test_apparent_wind_of_another_device_is_preferred_to_a_computed_one(deliver, make):
    sensor = make("wind")
    assert len(deliver(sensor, wind(5.0, 90.0, BOW, 0x0D), now_s=1.0)) == 1  # of a display
    assert deliver(sensor, wind(6.0, 80.0), wind(5.0, 90.0, BOW, 0x0D), now_s=2.0) == ()
    samples = deliver(sensor, wind(6.0, 80.0), wind(5.0, 90.0, BOW, 0x0D), now_s=6.1)
    assert [sample.reference for sample in samples] == [WindReference.APPARENT]


def test_configured_wind_source_is_used_with_any_reference(deliver, make):
    sensor = make("wind", source=0x0D)
    samples = deliver(sensor, wind(6.0, 80.0), wind(5.0, 90.0, BOW, 0x0D))
    assert [sample.reference for sample in samples] == [WindReference.BOW]
    assert deliver(sensor, wind(6.0, 80.0)) == ()
    assert sensor.health(1.0).text == "second wind source 0x40 not used"


@pytest.mark.parametrize(
    ("offset_m", "option_m", "expected"), [(None, 0.5, 12.5), (0.7, 0.5, 12.7), (-0.9, 0.5, 12.5), (0.0, 0.5, 12.5)]
)
def test_depth_below_the_surface(deliver, make, offset_m, option_m, expected):
    sensor = make("depth", transducer_depth_m=option_m)
    (sample,) = deliver(sensor, depth(12.0, offset_m), now_s=2.5)
    assert (sample.t_s, sample.depth_m) == (2.5, pytest.approx(expected))
    assert sample.transducer_m == pytest.approx(expected - 12.0)
    assert (sensor.health(2.5).role, sensor.health(2.5).accepted) == (DeviceRole.DEPTH, 1)


@pytest.mark.parametrize("depth_m", [None, 0.0])
def test_sounder_that_has_lost_the_bottom(deliver, make, depth_m):
    sensor = make("depth")
    assert deliver(sensor, depth(depth_m)) == ()
    assert (sensor.health(1.0).state, sensor.health(1.0).text) == (DeviceState.RUNNING, "no bottom")
    assert len(deliver(sensor, depth(3.0))) == 1
    assert sensor.health(1.0).text == ""


def test_sounder_with_a_bottom_replaces_one_without(deliver, make):
    sensor = make("depth")
    deliver(sensor, depth(None))
    assert [sample.depth_m for sample in deliver(sensor, depth(9.0, source=0x51), depth(None), now_s=1.0)] == [9.0]
    assert deliver(sensor, depth(None, source=0x51), depth(3.0), now_s=6.0) == ()
    assert len(deliver(sensor, depth(None, source=0x51), depth(3.0), now_s=6.01)) == 1


def test_impossible_depth_is_rejected(deliver, make):
    sensor = make("depth")
    assert deliver(sensor, depth(12_000.1)) == ()
    assert (sensor.health(1.0).rejected, sensor.health(1.0).text) == (1, "depth_m 12000.1 out of range")
    assert len(deliver(sensor, depth(12_000.0))) == 1


def test_second_sounder_is_not_mixed(deliver, make):
    sensor = make("depth")
    assert len(deliver(sensor, depth(3.0), depth(9.0, source=0x51))) == 1
    assert sensor.health(1.0).text == "second depth source 0x51 not used"
