"""A link sends at most the byte rate of a slow line; heartbeats and acknowledgements have priority."""

import itertools
import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.records import DepthSample, Event, FixType, PositionSample, RudderFeedback, Severity
from firmware_py.common.reports import Activity, Home, MissionReport, Navigation, Power, Wind
from firmware_py.link.telemetry.table import TABLE

BITS_PER_BYTE = 10
SECONDS = 60.0
TICK_S = 0.1
# These messages are not sent in this test: two need a compass swing, and the third needs another vessel.
CONDITIONAL_MESSAGES = {"MAG_CAL_PROGRESS", "MAG_CAL_REPORT", "AIS_VESSEL"}
FIX = PositionSample(0.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, math.pi / 2, 8, 1.25)
SNAPSHOT_FIELDS = {
    "position": FIX, "position_ok": True, "home": Home(0.7, -0.2, 1.0),
    "servo": RudderFeedback(0.0, 0.1, 31.0, 12.0, 0.2), "bearing_rad": 1.0, "distance_m": 50.0,
    "navigation": Navigation(Activity.LINE, 0.7, -0.2), "power": Power(12.6),
    "mission": MissionReport(identities=(0, 7, 0)),
    "wind": Wind(1.0, north_m_s=1.0, east_m_s=2.0), "wind_ok": True, "depth": DepthSample(1.0, 12.0), "depth_ok": True,
}  # fmt: skip
MIN_INTERVAL_US = 20_000  # less than a tick: the message is sent at each tick
OVERRIDE = mavlink.MAVLink_rc_channels_override_message(1, 1, 1600, 0, 0, 0, 0, 0, 0, 0)


def long_command(number, *values):
    values = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)


class Line:
    """Records the time and size of everything that a link sends, and decodes the messages."""

    def __init__(self, rig):
        self.rig = rig
        self.transmissions = []  # (time, number of bytes)
        self.messages = []  # (time, message)
        self._decoder = mavlink.MAVLink(None)

    def read_transport(self):
        for _, data in self.rig.transport.sent:
            self.transmissions.append((self.rig.now_s, len(data)))
            self.messages += [(self.rig.now_s, message) for message in self._decoder.parse_buffer(data) or []]
        self.rig.transport.sent.clear()

    def message_times_s(self, name):
        return [t_s for t_s, message in self.messages if message.get_type() == name]

    def max_bytes_in_window(self, window_s):
        """Return the largest number of bytes that are sent within any window of this length."""
        max_bytes = 0
        for start, (start_s, _) in enumerate(self.transmissions):
            end_s = start_s + window_s - 1e-6
            max_bytes = max(max_bytes, sum(size for t_s, size in self.transmissions[start:] if t_s < end_s))
        return max_bytes


@pytest.mark.parametrize("baud", [57600, 9600])
def test_line_is_full_but_not_exceeded_with_all_messages_at_the_highest_rate(make_rig, baud):
    line_bytes_s = baud / BITS_PER_BYTE
    rig = make_rig(byte_rate=line_bytes_s, has_radio_rates=True, is_datagram=False)
    line = Line(rig)
    for number in sorted({row.number for row in TABLE} - {0}):
        request = long_command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, MIN_INTERVAL_US)
        rig.transport.inbox.append(("station", rig.frame(request)))
        rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    line.read_transport()
    request_times_s = []
    while rig.now_s < SECONDS:
        if round(rig.now_s / TICK_S) % 10 == 5:
            check_request = long_command(mavlink.MAV_CMD_RUN_PREARM_CHECKS)
            rig.transport.inbox += [("station", rig.frame(message)) for message in (OVERRIDE, check_request)]
            request_times_s.append(rig.now_s)
            rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
            line.read_transport()
        rig.tick_silently(seconds=TICK_S, events=[Event(Severity.INFO, "text " * 8)], **SNAPSHOT_FIELDS)
        line.read_transport()
        rig.now_s += 0.013  # time between the tick and the next call of the link
        rig.endpoint.service(rig.now_s, [])
        line.read_transport()
    # An idle line accumulates 0.25 s of sending time, at least one frame of the maximum size.
    burst_bytes = max(280.0, 0.25 * line_bytes_s)
    total = sum(size for _, size in line.transmissions)
    assert total <= line_bytes_s * SECONDS + burst_bytes
    assert total >= 0.9 * line_bytes_s * SECONDS
    for window_s in (0.2, 1.0, 5.0):
        assert line.max_bytes_in_window(window_s) <= line_bytes_s * window_s + burst_bytes
    heartbeat_times_s = line.message_times_s("HEARTBEAT")
    assert len(heartbeat_times_s) == pytest.approx(SECONDS, abs=3)
    assert max(second - first for first, second in itertools.pairwise(heartbeat_times_s)) < 1.3
    acknowledgement_times_s = [
        t_s
        for t_s, message in line.messages
        if message.get_type() == "COMMAND_ACK" and message.command == mavlink.MAV_CMD_RUN_PREARM_CHECKS
    ]
    delays_s = [end_s - begin_s for begin_s, end_s in zip(request_times_s, acknowledgement_times_s, strict=True)]
    assert max(delays_s) < 0.5
    names = {row.name.split()[0] for row in TABLE} - CONDITIONAL_MESSAGES
    assert {message.get_type() for _, message in line.messages} >= names


@pytest.mark.parametrize("baud", [57600, 9600])
def test_default_rates_of_a_radio_use_only_part_of_the_line(make_rig, baud):
    """The default messages need less than a third of a line of 57600 baud, and fit on a line of 9600 baud."""
    rig = make_rig(byte_rate=baud / BITS_PER_BYTE, has_radio_rates=True, is_datagram=False)
    line = Line(rig)
    while rig.now_s < SECONDS:
        rig.tick_silently(seconds=TICK_S, **SNAPSHOT_FIELDS)
        line.read_transport()
    total = sum(size for _, size in line.transmissions)
    assert total < (0.33 if baud == 57600 else 0.9) * baud / BITS_PER_BYTE * SECONDS
    assert len(line.message_times_s("HEARTBEAT")) == pytest.approx(SECONDS, abs=2)
