"""A serial line, by a ByteLine in memory."""

import pytest

from firmware_py.link.wire.open_transport import open_transport
from support.line import FakeLine


@pytest.fixture
def line():
    return FakeLine(name="/dev/ttyX")


@pytest.mark.parametrize(("baud", "radio"), [(9600, True), (57600, True), (115200, True), (921600, False)])
def test_the_line_is_opened_with_its_baud_rate_which_sets_its_pace(line, baud, radio):
    query = []
    transport = open_transport(f"serial:/dev/ttyX:{baud}", lambda path, rate: query.append((path, rate)) or line)
    assert query == [("/dev/ttyX", baud)]
    assert (transport.byte_rate, transport.radio) == (baud / 10, radio)


def test_bytes_pass_both_ways_and_a_line_that_is_away_refuses_them(line):
    transport = open_transport("serial:/dev/ttyX:57600", lambda *_: line)
    (address,) = transport.addresses()
    line.inbox += b"in"
    assert transport.receive(7) == ((address, b"in"),)
    assert transport.receive(7) == ()
    assert transport.send(address, b"out")
    assert line.written == [b"out"]
    line.unplug()
    assert transport.descriptors() == ()
    assert not transport.send(address, b"out")
