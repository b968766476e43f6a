"""A radio modem that is slower than its serial line reports its free buffer; the autopilot adapts its sending rate."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.telemetry.table import TABLE
from support.link import of_type

LINE_BYTES_S = 5760.0
BUFFER_BYTES = 2000
UNLIMITED_BYTES_S = 1e9
MIN_INTERVAL_US = 20_000  # less than a tick: the message is sent at each tick


def radio_status(free_percent):
    return mavlink.MAVLink_radio_status_message(150, 150, int(free_percent), 40, 40, 0, 0)


class Modem:
    """Buffers the bytes of the line, transmits them at its own rate, and reports its buffer each second."""

    def __init__(self, rig, air_bytes_s):
        self.rig, self.air_bytes_s = rig, air_bytes_s
        self.buffered_bytes = self.lost_bytes = self.transmitted_bytes = 0

    def run(self, seconds, *, free_percent=None):
        """Run for some seconds; return the number of bytes that the modem transmitted.

        The modem reports its buffer after each second, or `free_percent` before each second.
        """
        transmitted_before = self.transmitted_bytes
        for _ in range(seconds):
            if free_percent is not None:
                self.report(free_percent)
            for _ in range(10):
                self.rig.tick_silently()
                received_bytes = sum(len(data) for _, data in self.rig.transport.sent)
                self.rig.transport.sent.clear()
                step_bytes = min(self.buffered_bytes, self.air_bytes_s * 0.1)
                self.transmitted_bytes += step_bytes
                self.lost_bytes += max(0, self.buffered_bytes - step_bytes + received_bytes - BUFFER_BYTES)
                self.buffered_bytes = min(self.buffered_bytes - step_bytes + received_bytes, BUFFER_BYTES)
            if free_percent is None:
                self.report(100.0 - 100.0 * self.buffered_bytes / BUFFER_BYTES)
        return self.transmitted_bytes - transmitted_before

    def report(self, free_percent):
        self.rig.send(radio_status(free_percent))
        self.rig.transport.sent.clear()


@pytest.fixture
def make_modem(make_rig):
    def make(air_bytes_s=UNLIMITED_BYTES_S, **options):
        rig = make_rig(**{"byte_rate": LINE_BYTES_S, "has_radio_rates": True, "is_datagram": False, **options})
        rig.endpoint.service(0.0, [])
        for number in {row.number for row in TABLE}:
            rig.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, MIN_INTERVAL_US)
        return Modem(rig, air_bytes_s)

    return make


@pytest.mark.parametrize("air_bytes_s", [400.0, 1000.0, 2500.0])
def test_requested_telemetry_uses_the_rate_of_the_radio(make_modem, air_bytes_s):
    modem = make_modem(air_bytes_s)
    modem.run(20)
    modem.lost_bytes = 0
    sent = modem.run(60)
    assert modem.lost_bytes < 0.05 * sent
    assert sent > 0.6 * 60 * air_bytes_s


def test_heartbeats_and_replies_are_sent_despite_a_full_buffer(make_modem):
    rig = make_modem().rig
    replies = []
    for second in range(60):
        for _ in range(3):
            rig.send(radio_status(0))
        if second == 30:
            replies += rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        replies += rig.ticks(10)
    assert len(of_type(replies, "HEARTBEAT")) >= 50
    assert len(of_type(replies, "COMMAND_ACK")) == len(of_type(replies, "AUTOPILOT_VERSION")) == 1


def test_network_ignores_radio_status(make_modem):
    modem = make_modem(byte_rate=None, is_datagram=True)
    assert modem.run(20, free_percent=0) > 0.5 * 20 * LINE_BYTES_S
