"""Sharing of one line by two drivers."""

import pytest

from firmware_py.sensors.line_tee import LineTee
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from firmware_py.sensors.nmea_position import NmeaPosition, NmeaPositionOptions

MAX_QUEUED_BYTES = 65536


@pytest.fixture
def tee(line):
    return LineTee(line)


def test_both_views_read_all_bytes(line, tee):
    line.inbox += b"x" * 5000 + b"y"
    assert tee.first_view.read() + tee.first_view.read() == b"x" * 5000 + b"y"
    assert [len(tee.second_view.read()) for _ in range(3)] == [4096, 905, 0]


def test_only_the_first_view_has_a_descriptor_and_both_write(line, tee):
    assert (tee.first_view.fileno(), tee.second_view.fileno()) == (7, -1)
    assert tee.first_view.write(b"a")
    assert tee.second_view.write(b"b")
    assert line.written == [b"a", b"b"]
    for view in (tee.first_view, tee.second_view):
        assert (view.name, view.baud, view.openings, view.connected) == (line.name, 57600, 1, True)


def test_bytes_from_before_a_reopening_are_discarded(line, tee):
    line.inbox += b"old"
    tee.first_view.read()
    line.unplug()
    line.plug()
    assert tee.second_view.read() == b""
    line.inbox += b"new"
    tee.first_view.read()
    assert tee.second_view.read() == b"new"
    line.plug()
    line.inbox += b"newest"
    tee.first_view.read()
    assert tee.second_view.read() == b"newest"


def test_queue_of_a_second_view_without_reads_keeps_the_newest_bytes(line, tee):
    for data in [b"x" * 4096] * 100 + [b"end"]:
        line.inbox += data
        tee.first_view.read()
    queued = b"".join(iter(tee.second_view.read, b""))
    assert len(queued) == MAX_QUEUED_BYTES
    assert queued.endswith(b"end")


def test_satellite_compass_provides_headings_and_positions(line, tee, nmea):
    compass, position = (
        NmeaCompass(tee.first_view, NmeaCompassOptions()),
        NmeaPosition(tee.second_view, NmeaPositionOptions()),
    )
    line.inbox += nmea("GPHDT,274.07,T") + nmea("GPGGA,194100.00,4221.8235522,N,07101.9438007,W,1,04,1.4,6.9,M,,M,,")
    compass.receive(1.0)
    position.receive(1.0)
    position.receive(2.0)
    assert len(compass.poll()) == len(position.poll()) == 1
