"""NMEA 2000 compass: headings, their reference, rate and attitude, choice of the device, start of the gateway."""

import math

import pytest

from firmware_py.common.options import record_from
from firmware_py.common.records import DeviceRole, DeviceState, NorthReference
from firmware_py.sensors.nmea2000_compass import Nmea2000Compass
from firmware_py.sensors.nmea2000_reader import Nmea2000Options
from hil.devices import nmea2000_frames as n2k
from support.line import FakeLine

START = bytes.fromhex("1002A10311020049" + "1003")
ADDRESS_CLAIM = 60928


@pytest.fixture
def compass(line):
    return Nmea2000Compass(line, Nmea2000Options())


def heading(angle_deg, reference=n2k.MAGNETIC, source=0x23, **corrections_deg):
    corrections = {f"{name}_rad": math.radians(value) for name, value in corrections_deg.items()}
    angle_rad = None if angle_deg is None else math.radians(angle_deg)
    return n2k.actisense_message(127250, source, n2k.heading(angle_rad, reference, **corrections))


def rate(deg_s, source=0x23):
    return n2k.actisense_message(127251, source, n2k.rate_of_turn(None if deg_s is None else math.radians(deg_s)))


def attitude(roll_deg, pitch_deg, source=0x23):
    return n2k.actisense_message(127257, source, n2k.attitude(math.radians(roll_deg), math.radians(pitch_deg)))


def degrees(samples):
    return [round(math.degrees(sample.heading_rad), 1) for sample in samples]


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (heading(98.3), (98.3, "MAGNETIC", None)),
        (heading(98.3, deviation=2.0), (100.3, "MAGNETIC", None)),
        (heading(98.3, deviation=2.0, variation=-10.0), (90.3, "TRUE", -10.0)),
        (heading(5.0, variation=-10.0), (355.0, "TRUE", -10.0)),
        (heading(98.3, n2k.TRUE), (98.3, "TRUE", None)),
        (heading(98.3, n2k.TRUE, deviation=2.0, variation=-10.0), (98.3, "TRUE", -10.0)),
        (heading(359.999, n2k.TRUE), (0.0, "TRUE", None)),
    ],
)
def test_heading_and_its_reference(deliver, compass, message, expected):
    (sample,) = deliver(compass, message, now_s=3.5)
    variation_deg = None if sample.variation_rad is None else round(math.degrees(sample.variation_rad), 1)
    assert (degrees([sample])[0] % 360.0, sample.reference.name, variation_deg) == expected
    assert (sample.t_s, sample.source, sample.yaw_rate_rad_s, sample.roll_rad) == (3.5, 0, None, None)


@pytest.mark.parametrize("message", [heading(None), heading(10.0, 2), heading(10.0, n2k.UNKNOWN_REFERENCE)])
def test_message_without_a_heading_gives_no_sample(deliver, compass, message):
    assert deliver(compass, message) == ()
    health = compass.health(1.0)
    assert (health.role, health.state, health.accepted) == (DeviceRole.COMPASS, DeviceState.STARTING, 0)
    assert health.text == "bus running, without the messages of this device"
    assert degrees(deliver(compass, heading(20.0, source=0x24))) == [20.0]  # the first one has not become the source
    assert deliver(compass, message.replace(b"\xff\x23", b"\xff\x24")) == ()


def test_device_that_loses_its_heading_is_reported(deliver, compass):
    deliver(compass, heading(10.0))
    deliver(compass, heading(None), now_s=1.1)
    assert compass.health(1.1).text == "no heading from the device"
    deliver(compass, heading(10.0), now_s=1.2)
    assert compass.health(1.2).text == ""
    assert compass.health(4.3).state is DeviceState.SILENT


def test_rate_of_turn_is_used_while_it_is_recent(deliver, compass):
    deliver(compass, heading(1.0), now_s=0.9)
    (sample,) = deliver(compass, rate(-2.0), heading(1.0))
    assert math.degrees(sample.yaw_rate_rad_s) == pytest.approx(-2.0, abs=1e-5)
    assert deliver(compass, heading(1.0), now_s=2.0)[0].yaw_rate_rad_s is not None
    assert deliver(compass, heading(1.0), now_s=2.01)[0].yaw_rate_rad_s is None
    for invalid in (rate(None), rate(61.0)):
        assert deliver(compass, rate(1.0), invalid, heading(1.0), now_s=2.2)[0].yaw_rate_rad_s is None
    assert deliver(compass, rate(59.9), heading(1.0), now_s=2.2)[0].yaw_rate_rad_s is not None


def test_attitude_is_used_while_it_is_recent(deliver, compass):
    deliver(compass, heading(1.0), now_s=0.9)
    (sample,) = deliver(compass, attitude(3.0, -4.0), heading(1.0))
    assert [math.degrees(sample.roll_rad), math.degrees(sample.pitch_rad)] == pytest.approx([3.0, -4.0], abs=0.01)
    assert deliver(compass, heading(1.0), now_s=3.5)[0].roll_rad is not None
    assert deliver(compass, heading(1.0), now_s=3.51)[0].roll_rad is None
    assert deliver(compass, attitude(3.0, 90.1), heading(1.0), now_s=3.7)[0].pitch_rad is None
    assert deliver(compass, attitude(3.0, 89.9), heading(1.0), now_s=3.7)[0].pitch_rad is not None


def test_other_devices_are_not_mixed_with_the_source(deliver, compass):
    deliver(compass, heading(10.0), now_s=1.0)
    samples = deliver(
        compass,
        heading(100.0, source=0x24),
        rate(5.0, 0x24),
        attitude(9.0, 9.0, 0x24),
        heading(11.0),
        now_s=1.1,
    )
    assert degrees(samples) == [11.0]
    assert (samples[0].yaw_rate_rad_s, samples[0].roll_rad) == (None, None)
    assert compass.health(1.1).text == "second heading source 0x24 not used"
    assert compass.health(1.1).rejected == 0


def test_configured_source_that_is_not_on_the_bus_is_reported_as_long_as_it_is_missing(deliver, line):
    compass = Nmea2000Compass(line, Nmea2000Options(source=0x55))
    for now_s in (1.0, 20.0):
        assert deliver(compass, heading(10.0), now_s=now_s) == ()
        assert compass.health(now_s).text == "no heading from source 0x55, but from 0x23"


def test_second_source_takes_over_after_silence_without_values_of_the_first(deliver, compass):
    deliver(compass, heading(10.0), now_s=1.0)
    deliver(compass, rate(5.0), attitude(1.0, 1.0), heading(10.0), now_s=2.0)
    assert deliver(compass, heading(20.0, source=0x24), now_s=5.0) == ()
    (sample,) = deliver(compass, heading(20.0, source=0x24), now_s=5.01)
    assert (degrees([sample]), sample.yaw_rate_rad_s, sample.roll_rad) == ([20.0], None, None)
    assert deliver(compass, heading(10.0), now_s=5.1) == ()


@pytest.mark.parametrize("source", [0x23, 0x24])
def test_values_from_before_the_line_was_reopened_are_not_used(deliver, line, compass, source):
    deliver(compass, heading(10.0, n2k.TRUE) * 3, rate(5.0), attitude(1.0, 1.0), now_s=1.0)
    line.plug()
    (sample,) = deliver(compass, heading(20.0, source=source), now_s=1.1)
    assert (degrees([sample]), sample.yaw_rate_rad_s, sample.roll_rad) == ([20.0], None, None)


def test_start_of_a_message_and_count_of_damage_end_when_the_line_is_reopened(deliver, line, compass):
    message = heading(10.0)
    deliver(compass, message[:15] + bytes([message[15] ^ 1]) + message[16:])
    assert deliver(compass, message[:10]) == ()
    line.plug()
    assert deliver(compass, message[10:], now_s=1.1) == ()
    assert compass.health(1.1).rejected == 1


def test_configured_source(line, deliver):
    compass = Nmea2000Compass(line, Nmea2000Options(source=0x24))
    assert degrees(deliver(compass, heading(10.0), heading(20.0, source=0x24))) == [20.0]


def test_frequent_true_headings_suppress_magnetic_ones(deliver, compass):
    messages = heading(10.0, n2k.TRUE), heading(8.0)
    counts = [len(deliver(compass, *messages, now_s=float(second))) for second in range(4)]
    assert counts == [2, 2, 1, 1]
    assert deliver(compass, heading(8.0), now_s=5.0) == ()
    assert len(deliver(compass, heading(8.0), now_s=5.01)) == 1


def test_true_headings_every_two_seconds_suppress_magnetic_ones(deliver, compass):
    counts = [len(deliver(compass, heading(10.0, n2k.TRUE), heading(8.0), now_s=2.0 * count)) for count in range(4)]
    assert counts == [2, 2, 1, 1]


def test_rare_true_headings_do_not_suppress_magnetic_ones(deliver, compass):
    for second in range(0, 30, 3):
        references = [sample.reference for sample in deliver(compass, heading(8.0), now_s=float(second))]
        assert references == [NorthReference.MAGNETIC]
        deliver(compass, heading(20.0, n2k.TRUE), now_s=second + 0.1)


def test_gateway_is_started_and_started_again_while_it_gives_no_heading(line, compass):
    written = []
    for tenths in range(120):
        compass.receive(tenths / 10.0)
        written.append(len(line.written))
    assert (written[0], written[49], written[50], written[100]) == (1, 1, 2, 3)
    assert set(line.written) == {START}
    for tenths in range(120, 240):
        line.inbox += heading(10.0)
        compass.receive(tenths / 10.0)
    assert len(line.written) == 3
    line.openings += 1
    compass.receive(24.0)
    assert len(line.written) == 4


@pytest.mark.parametrize(
    ("port", "gateway", "writes"),
    [("/dev/x", "auto", True), ("/dev/x", "yd_raw", False), ("tcp:1.2.3.4:5", "auto", False),
     ("udp:2000", "auto", False), ("tcp:1.2.3.4:5", "actisense", True), ("can:can0", "actisense", False)],
)  # fmt: skip
def test_only_an_actisense_gateway_gets_a_command(port, gateway, writes):
    line = FakeLine(name=port)
    Nmea2000Compass(line, Nmea2000Options(gateway=gateway)).receive(0.0)
    assert bool(line.written) is writes


def test_forms_by_port():
    data = n2k.heading(math.radians(30.0), n2k.TRUE)
    raw = Nmea2000Compass(line := FakeLine(name="udp:2000"), Nmea2000Options())
    line.inbox += n2k.raw_line(127250, 0x23, data)
    raw.receive(1.0)
    assert degrees(raw.poll()) == [30.0]
    can = Nmea2000Compass(line := FakeLine(name="can:can0"), Nmea2000Options())
    line.inbox += (n2k.identifier(127250, 0x23) | 1 << 31).to_bytes(4, "little") + b"\x08\0\0\0" + data
    can.receive(1.0)
    assert degrees(can.poll()) == [30.0]


def test_backlog_is_read_up_to_a_limit_and_the_number_of_messages_is_limited(line, compass):
    line.inbox += heading(10.0) * 2000  # 26 bytes each
    compass.receive(1.0)
    assert len(line.inbox) == 52_000 - 8 * 4096
    assert len(compass.poll()) == 200
    health = compass.health(1.0)
    assert health.text == "too many messages, some dropped"
    assert health.rejected == 8 * 4096 // 26 - 200
    line.inbox[:] = heading(10.0) * 60
    compass.receive(1.1)
    assert len(compass.poll()) == 50  # 500 a second


def test_number_of_samples_between_two_polls_is_limited(line, compass):
    for tenths in range(20):
        line.inbox += heading(10.0) * 30
        compass.receive(tenths / 10.0)
    assert len(compass.poll()) == 512


@pytest.mark.parametrize(("size", "reads"), [(2047, 1), (2048, 2)])
def test_short_read_is_the_last_one(size, reads):
    pieces = [b"x" * size, b"x", b""]
    line = FakeLine()
    line.read = lambda: pieces.pop(0)
    Nmea2000Compass(line, Nmea2000Options()).receive(1.0)
    assert len(pieces) == 3 - reads


def test_options():
    assert (Nmea2000Options().source, Nmea2000Options().gateway) == (-1, "auto")
    for values in ({"source": -2}, {"source": 252}, {"gateway": "nmea"}):
        with pytest.raises(ValueError, match=next(iter(values))):
            record_from(Nmea2000Options, values)
        with pytest.raises(ValueError, match=next(iter(values))):
            Nmea2000Options(**values)
    assert record_from(Nmea2000Options, {"source": 251, "gateway": "yd_raw"}).source == 251


def test_wrong_baud_rate_is_reported(deliver, compass):
    for second in range(4):
        deliver(compass, bytes(range(256)) * 2, now_s=float(second))
    assert compass.health(3.0).text == "data not understood: wrong baud rate?"
    assert compass.health(3.0).state is DeviceState.STARTING


def test_damaged_and_short_messages_are_counted(deliver, compass):
    message = heading(10.0)
    deliver(compass, message[:15] + bytes([message[15] ^ 1]) + message[16:])
    assert (compass.health(1.0).rejected, compass.health(1.0).text) == (1, "damaged or incomplete message")
    deliver(compass, n2k.actisense_message(127250, 0x23, bytes(5)), now_s=2.0)
    assert (compass.health(2.0).rejected, compass.health(2.0).text) == (2, "Vessel Heading: 5 bytes")


def test_address_claim_moves_the_source(deliver, compass):
    name = n2k.to_bytes(n2k.unsigned(5, 21) + n2k.unsigned(1851, 11))
    deliver(compass, n2k.actisense_message(ADDRESS_CLAIM, 0x23, name), heading(10.0), now_s=1.0)
    moved = n2k.actisense_message(ADDRESS_CLAIM, 0x31, name), heading(12.0, source=0x31), heading(80.0)
    assert degrees(deliver(compass, *moved, now_s=1.1)) == [12.0]
