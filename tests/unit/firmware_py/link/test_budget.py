"""A slow line never gets more than it carries, whatever is asked, and heartbeats and acknowledgements come first."""

import itertools
import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.records import Event, FixType, PositionSample, RudderFeedback, Severity
from firmware_py.common.reports import Activity, Home, MissionReport, Navigation, Power
from firmware_py.link.telemetry.table import TABLE

BITS_PER_BYTE = 10
SECONDS = 60.0
TICK_S = 0.1
NOT_NOW = (191, 192, 301, 437)  # only during a swing of the compass; of other vessels; only on request
FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, math.pi / 2, 8, 1.25)
BOAT = {
    "position": FIX, "position_ok": True, "home": Home(0.7, -0.2, 1.0),
    "servo": RudderFeedback(0.0, 0.1, 31.0, 12.0, 0.2), "bearing_rad": 1.0, "distance_m": 50.0,
    "navigation": Navigation(Activity.LINE, 0.7, -0.2), "power": Power(12.6),
    "mission": MissionReport(identities=(0, 7, 0)),
}  # fmt: skip


OVERRIDE = mavlink.MAVLink_rc_channels_override_message(1, 1, 1600, 0, 0, 0, 0, 0, 0, 0)


class Line:
    """Counts what is sent when, and decodes it."""

    def __init__(self, rig):
        self.rig = rig
        self.sent = []  # (time, bytes)
        self.received = []  # (time, message)
        self._decoder = mavlink.MAVLink(None)

    def take(self):
        for _, data in self.rig.transport.sent:
            self.sent.append((self.rig.now_s, len(data)))
            self.received += [(self.rig.now_s, message) for message in self._decoder.parse_buffer(data) or []]
        self.rig.transport.sent.clear()

    def times(self, name):
        return [t_s for t_s, message in self.received if message.get_type() == name]

    def most_in(self, window_s):
        """The most bytes that any window of this length holds."""
        most = 0
        for start, (from_s, _) in enumerate(self.sent):
            most = max(most, sum(size for t_s, size in self.sent[start:] if t_s < from_s + window_s - 1e-6))
        return most


@pytest.mark.parametrize("baud", [57600, 9600])
def test_with_everything_asked_at_the_fastest_rate_the_line_is_full_and_no_more(make_rig, baud):
    rate = baud / BITS_PER_BYTE
    rig = make_rig(byte_rate=rate, has_radio_rates=True, is_datagram=False)
    line = Line(rig)
    for number in sorted({row.number for row in TABLE} - {0}):
        rig.transport.inbox.append(("station", rig.frame(long_command(511, number, 20_000))))
        rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    line.take()
    acknowledged = []
    while rig.now_s < SECONDS:
        if round(rig.now_s / TICK_S) % 10 == 5:
            rig.transport.inbox += [("station", rig.frame(one)) for one in (OVERRIDE, long_command(401))]
            acknowledged.append(rig.now_s)
            rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
            line.take()
        rig.tick_silently(seconds=TICK_S, events=[Event(Severity.INFO, "talk " * 8)], **BOAT)
        line.take()
        rig.now_s += 0.013  # the slack
        rig.endpoint.service(rig.now_s, [])
        line.take()
    burst = max(280.0, 0.25 * rate)
    total = sum(size for _, size in line.sent)
    assert total <= rate * SECONDS + burst
    assert total >= 0.9 * rate * SECONDS  # and it is not wasted
    for window_s in (0.2, 1.0, 5.0):
        assert line.most_in(window_s) <= rate * window_s + burst
    beats = line.times("HEARTBEAT")
    assert len(beats) == pytest.approx(SECONDS, abs=3)
    assert max(second - first for first, second in itertools.pairwise(beats)) < 1.3
    acks = [t_s for t_s, message in line.received if message.get_type() == "COMMAND_ACK" and message.command == 401]
    assert len(acks) == len(acknowledged)
    assert max(ack - query for ack, query in zip(acks, acknowledged, strict=True)) < 0.5
    assert {message.get_type() for _, message in line.received} >= {
        row.name.split()[0] for row in TABLE if row.number not in NOT_NOW
    }


def long_command(number, *values):
    values = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)


@pytest.mark.parametrize("baud", [57600, 9600])
def test_the_rates_of_a_radio_leave_room_on_the_line(make_rig, baud):
    """What a 57600 radio gets unasked is under a third of it; 9600 baud carries all of it, too."""
    rig = make_rig(byte_rate=baud / BITS_PER_BYTE, has_radio_rates=True, is_datagram=False)
    line = Line(rig)
    while rig.now_s < SECONDS:
        rig.tick_silently(seconds=TICK_S, **BOAT)
        line.take()
    total = sum(size for _, size in line.sent)
    assert total < (0.33 if baud == 57600 else 0.9) * baud / BITS_PER_BYTE * SECONDS
    assert len(line.times("HEARTBEAT")) == pytest.approx(SECONDS, abs=2)
