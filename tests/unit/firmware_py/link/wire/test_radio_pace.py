"""A radio modem that is slower by air than its line: the boat sends no more than it keeps up with."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.telemetry.table import TABLE
from support.link import of_type

LINE_BYTES_S = 5760.0
BUFFER_BYTES = 2000


class Modem:
    """Takes bytes from the line into a buffer, sends them by air at a speed of its own, and reports each second."""

    def __init__(self, rig, air_bytes_s):
        self.rig, self.air_bytes_s = rig, air_bytes_s
        self.waiting = self.lost = self.sent = 0

    def second(self, *, sends=True):
        for _ in range(10):
            self.rig.tick_silently()
            came = sum(len(data) for _, data in self.rig.transport.sent)
            self.rig.transport.sent.clear()
            gone = min(self.waiting, self.air_bytes_s * 0.1)
            self.sent += gone
            self.lost += max(0, self.waiting - gone + came - BUFFER_BYTES)
            self.waiting = min(self.waiting - gone + came, BUFFER_BYTES)
        if sends:
            self.tell(100.0 - 100.0 * self.waiting / BUFFER_BYTES)

    def tell(self, free_percent):
        self.rig.tell(mavlink.MAVLink_radio_status_message(150, 150, int(free_percent), 40, 40, 0, 0))
        self.rig.transport.sent.clear()


@pytest.fixture
def radio(make_rig):
    def make(air_bytes_s, **more):
        rig = make_rig(**{"byte_rate": LINE_BYTES_S, "radio": True, "datagrams": False, **more})
        rig.endpoint.service(0.0, [])
        for number in {row.number for row in TABLE}:
            rig.command(511, number, 20_000)  # at each tick
        return Modem(rig, air_bytes_s)

    return make


@pytest.mark.parametrize("air_bytes_s", [400.0, 1000.0, 2500.0])
def test_telemetry_that_was_asked_for_leaves_as_fast_as_the_radio_takes_it(radio, air_bytes_s):
    modem = radio(air_bytes_s)
    for _ in range(20):
        modem.second()
    modem.lost = modem.sent = 0
    for _ in range(60):
        modem.second()
    assert modem.lost < 0.05 * modem.sent
    assert modem.sent > 0.6 * 60 * air_bytes_s


@pytest.mark.parametrize(("free_percent", "share"), [(19, 0.1), (20, 0.4), (49, 0.4), (50, 1.0), (91, 1.0)])
def test_the_fuller_the_modem_says_it_is_the_less_is_sent(radio, free_percent, share):
    modem = radio(1e9)
    for _ in range(5):
        modem.tell(free_percent)
    modem.second(sends=False)
    modem.sent = 0
    for _ in range(4):
        modem.second(sends=False)
    assert share - 0.1 < modem.sent / (4 * LINE_BYTES_S) < share + 0.1


def test_without_a_word_of_a_modem_the_line_is_filled(radio):
    modem = radio(1e9)
    for _ in range(20):
        modem.second(sends=False)
    assert modem.sent > 0.8 * 20 * LINE_BYTES_S


def test_a_modem_that_has_gone_is_forgotten(radio):
    modem = radio(1e9)
    for _ in range(10):
        modem.tell(0)
    modem.second(sends=False)
    assert modem.sent < 0.4 * LINE_BYTES_S
    for _ in range(11):
        modem.second(sends=False)
    modem.sent = 0
    modem.second(sends=False)
    assert modem.sent > 0.8 * LINE_BYTES_S


def test_however_full_it_says_it_is_heartbeats_and_answers_go_out(radio):
    modem = radio(1e9)
    rig = modem.rig
    replies = []
    for second in range(60):
        for _ in range(3):
            rig.tell(mavlink.MAVLink_radio_status_message(150, 150, 0, 40, 40, 0, 0))
        replies += rig.command(512, 148.0) if second == 30 else []
        replies += rig.ticks(10)
    assert len(of_type(replies, "HEARTBEAT")) >= 50
    assert len(of_type(replies, "COMMAND_ACK")) == len(of_type(replies, "AUTOPILOT_VERSION")) == 1


@pytest.mark.parametrize("free_percent", [101, 255])
def test_what_cannot_be_reports_nothing(radio, free_percent):
    modem = radio(1e9)
    for _ in range(20):
        modem.tell(free_percent)
        modem.second(sends=False)
    assert modem.sent > 0.8 * 20 * LINE_BYTES_S


def test_over_a_network_there_is_no_modem(radio):
    modem = radio(1e9, byte_rate=None, datagrams=True)
    for _ in range(20):
        modem.tell(0)
        modem.second(sends=False)
    assert modem.sent > 0.5 * 20 * LINE_BYTES_S
