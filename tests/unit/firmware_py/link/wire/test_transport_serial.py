"""A serial line, by a ByteLine in memory."""

import pytest

from firmware_py.link.wire.open_transport import open_transport


class Line:
    name = "/dev/ttyX"
    openings = 1

    def __init__(self):
        self.descriptor = 7
        self.inbox = b""
        self.outbox = b""

    @property
    def connected(self):
        return self.descriptor >= 0

    def fileno(self):
        return self.descriptor

    def read(self):
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data):
        if self.connected:
            self.outbox += data
        return self.connected


@pytest.fixture
def line():
    return Line()


@pytest.mark.parametrize(("baud", "radio"), [(9600, True), (57600, True), (115200, True), (921600, False)])
def test_the_line_is_opened_with_its_baud_rate_which_sets_its_pace(line, baud, radio):
    asked = []
    transport = open_transport(f"serial:/dev/ttyX:{baud}", lambda path, rate: asked.append((path, rate)) or line)
    assert asked == [("/dev/ttyX", baud)]
    assert (transport.byte_rate, transport.radio) == (baud / 10, radio)


def test_bytes_pass_both_ways_and_a_line_that_is_away_refuses_them(line):
    transport = open_transport("serial:/dev/ttyX:57600", lambda *_: line)
    (address,) = transport.addresses()
    line.inbox = b"in"
    assert transport.receive(7) == ((address, b"in"),)
    assert transport.receive(7) == ()
    assert transport.send(address, b"out")
    assert line.outbox == b"out"
    line.descriptor = -1
    assert transport.descriptors() == ()
    assert not transport.send(address, b"out")
