"""A radio modem that is slower than its serial line reports its free buffer, and the boat adapts its rate."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.telemetry.table import TABLE
from support.link import of_type

LINE_BYTES_S = 5760.0
BUFFER_BYTES = 2000
UNLIMITED = 1e9


def radio_status(free_percent):
    return mavlink.MAVLink_radio_status_message(150, 150, int(free_percent), 40, 40, 0, 0)


class Modem:
    """Buffers the bytes of the line, transmits them at its own rate, and reports its buffer each second."""

    def __init__(self, rig, air_bytes_s):
        self.rig, self.air_bytes_s = rig, air_bytes_s
        self.buffered = self.lost = self.sent = 0

    def run(self, seconds, *, sends_status=True, free_percent=None):
        """Run for some seconds; return the bytes that the modem transmitted."""
        sent_before = self.sent
        for _ in range(seconds):
            if free_percent is not None:
                self.report(free_percent)
            for _ in range(10):
                self.rig.tick_silently()
                received = sum(len(data) for _, data in self.rig.transport.sent)
                self.rig.transport.sent.clear()
                transmitted = min(self.buffered, self.air_bytes_s * 0.1)
                self.sent += transmitted
                self.lost += max(0, self.buffered - transmitted + received - BUFFER_BYTES)
                self.buffered = min(self.buffered - transmitted + received, BUFFER_BYTES)
            if sends_status and free_percent is None:
                self.report(100.0 - 100.0 * self.buffered / BUFFER_BYTES)
        return self.sent - sent_before

    def report(self, free_percent):
        self.rig.tell(radio_status(free_percent))
        self.rig.transport.sent.clear()


@pytest.fixture
def make_modem(make_rig):
    def make(air_bytes_s=UNLIMITED, **options):
        rig = make_rig(**{"byte_rate": LINE_BYTES_S, "has_radio_rates": True, "is_datagram": False, **options})
        rig.endpoint.service(0.0, [])
        for number in {row.number for row in TABLE}:
            rig.command(511, number, 20_000)  # at each tick
        return Modem(rig, air_bytes_s)

    return make


@pytest.mark.parametrize("air_bytes_s", [400.0, 1000.0, 2500.0])
def test_requested_telemetry_uses_the_rate_of_the_radio(make_modem, air_bytes_s):
    modem = make_modem(air_bytes_s)
    modem.run(20)
    modem.lost = 0
    sent = modem.run(60)
    assert modem.lost < 0.05 * sent
    assert sent > 0.6 * 60 * air_bytes_s


@pytest.mark.parametrize(("free_percent", "share"), [(19, 0.1), (20, 0.4), (49, 0.4), (50, 1.0), (91, 1.0)])
def test_full_buffer_reduces_the_rate(make_modem, free_percent, share):
    modem = make_modem()
    for _ in range(5):
        modem.report(free_percent)
    modem.run(1, sends_status=False)
    assert share - 0.1 < modem.run(4, sends_status=False) / (4 * LINE_BYTES_S) < share + 0.1


@pytest.mark.parametrize("free_percent", [None, 101, 255])
def test_line_is_filled_without_a_valid_status(make_modem, free_percent):
    sent = make_modem().run(20, sends_status=False, free_percent=free_percent)
    assert sent > 0.8 * 20 * LINE_BYTES_S


def test_rate_recovers_when_the_status_stops(make_modem):
    modem = make_modem()
    for _ in range(10):
        modem.report(0)
    assert modem.run(1, sends_status=False) < 0.4 * LINE_BYTES_S
    modem.run(11, sends_status=False)
    assert modem.run(1, sends_status=False) > 0.8 * LINE_BYTES_S


def test_heartbeats_and_replies_are_sent_despite_a_full_buffer(make_modem):
    rig = make_modem().rig
    replies = []
    for second in range(60):
        for _ in range(3):
            rig.tell(radio_status(0))
        replies += rig.command(512, 148.0) if second == 30 else []
        replies += rig.ticks(10)
    assert len(of_type(replies, "HEARTBEAT")) >= 50
    assert len(of_type(replies, "COMMAND_ACK")) == len(of_type(replies, "AUTOPILOT_VERSION")) == 1


def test_network_ignores_radio_status(make_modem):
    modem = make_modem(byte_rate=None, is_datagram=True)
    assert modem.run(20, free_percent=0) > 0.5 * 20 * LINE_BYTES_S
