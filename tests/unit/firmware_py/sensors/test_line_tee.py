"""Two drivers on one port each get every byte."""

import pytest

from firmware_py.sensors.line_tee import QUEUE_LIMIT, LineTee
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions


@pytest.fixture
def tee(line):
    return LineTee(line)


def test_both_views_read_all_bytes(line, tee):
    line.inbox += b"x" * 5000 + b"y"
    first = tee.first.read() + tee.first.read()
    assert first == b"x" * 5000 + b"y"
    assert [len(tee.second.read()) for _ in range(3)] == [4096, 905, 0]


def test_only_the_first_view_has_a_descriptor_and_both_write(line, tee):
    assert (tee.first.fileno(), tee.second.fileno()) == (7, -1)
    assert tee.first.write(b"a")
    assert tee.second.write(b"b")
    assert line.written == [b"a", b"b"]
    for view in (tee.first, tee.second):
        assert (view.name, view.openings, view.connected) == (line.name, 1, True)


def test_bytes_from_before_a_reopening_are_forgotten(line, tee):
    line.inbox += b"old"
    tee.first.read()
    line.unplug()
    line.plug()
    assert tee.second.read() == b""
    line.inbox += b"new"
    tee.first.read()
    assert tee.second.read() == b"new"


def test_a_second_view_without_reads_has_a_bounded_queue(line, tee):
    for _ in range(100):
        line.inbox += b"x" * 4096
        tee.first.read()
    line.inbox += b"end"
    tee.first.read()
    held = b"".join(iter(tee.second.read, b""))
    assert len(held) == QUEUE_LIMIT
    assert held.endswith(b"end")


def test_a_satellite_compass_feeds_both_drivers(line, tee, nmea):
    compass, position = NmeaCompass(tee.first, NmeaCompassOptions()), NmeaPosition(tee.second, NmeaPositionOptions())
    line.inbox += nmea("GPHDT,274.07,T") + nmea("GPGGA,194100.00,4221.8235522,N,07101.9438007,W,1,04,1.4,6.9,M,,M,,")
    compass.receive(1.0)
    position.receive(1.0)
    position.receive(2.0)
    assert len(compass.poll()) == len(position.poll()) == 1
