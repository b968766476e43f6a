"""Interface of the link to the loop, in memory and on real sockets."""

import os
import re
import select
import shutil
import socket
import struct
import subprocess
import sys
import tty
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.interfaces import Link
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Event, FixType, PositionSample, RudderCommand, Severity, Stored
from firmware_py.common.reports import Home, MissionReport, Output
from firmware_py.faults.table import TABLE, Fault
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import open_transport
from firmware_py.link.wire.urls import parse_options
from support.link import KEY, NOW, sign

INITIALISING = 16  # custom_mode of ArduRover
GROUND_STATION, ONBOARD_CONTROLLER = mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER


def test_first_heartbeat_is_sent_at_once_with_mode_initialising(make_rig, of):
    rig = make_rig()
    rig.endpoint.service(0.0, [])
    (beat,) = of(rig.replies(), "HEARTBEAT")
    assert (beat.custom_mode, beat.system_status, beat.get_srcSystem()) == (INITIALISING, mavlink.MAV_STATE_BOOT, 1)
    (beat,) = of(rig.tick(), "HEARTBEAT")
    assert beat.custom_mode == Mode.GUIDED


def test_heartbeats_are_sent_once_per_second(rig, of):
    beats = of(rig.ticks(100), "HEARTBEAT")
    assert len(beats) == pytest.approx(10, abs=1)


@pytest.mark.parametrize("change", [{"mode": Mode.HOLD}, {"armed": False}])
def test_change_of_mode_or_arming_is_reported_at_once(rig, of, change):
    replies = rig.tick(**change)
    assert len(of(replies, "HEARTBEAT")) == len(of(replies, "CURRENT_MODE")) == 1


def test_sequence_numbers_have_no_gaps(rig):
    numbers = []
    for _ in range(30):
        numbers += [message.get_seq() for message in rig.tick()]
        numbers += [
            message.get_seq()
            for message in rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        ]
    first = numbers[0]
    assert numbers == [(first + index) % 256 for index in range(len(numbers))]


def test_messages_of_a_tick_share_one_datagram(rig):
    rig.tick_silently(seconds=2.0)
    assert len(rig.transport.sent) == 1
    assert len(rig.transport.sent[0][1]) <= 1200


def test_events_are_reported_and_critical_ones_again_to_later_peers(make_rig, texts):
    rig = make_rig(addresses=("first",))
    events = [Event(Severity.CRITICAL, "critical"), Event(Severity.INFO, "minor")]
    assert texts(rig.tick(events=events)) == ["critical", "minor"]
    rig.transport.served = ("first", "later")
    rig.tick_silently()
    assert texts(rig.replies("later")) == ["critical"]


def test_later_peer_gets_warnings_with_their_age_and_no_ended_faults(make_rig, texts):
    rig = make_rig(addresses=("first",))
    events = [
        Event(Severity.CRITICAL, TABLE[Fault.COMPASS_LOST].text),
        Event(Severity.ERROR, TABLE[Fault.FENCE_BREACHED].text),
        Event(Severity.WARNING, "Failsafe: RTL"),
    ]
    rig.tick(events=events)
    rig.tick(events=[Event(Severity.NOTICE, TABLE[Fault.COMPASS_LOST].recovery)])
    replies = []
    for number, seconds in enumerate((30.0, 600.0, 5 * 3600.0, 3 * 86400.0)):
        rig.tick_silently(seconds=seconds)
        rig.transport.served = ("first", f"later {number}")
        rig.tick_silently()
        replies.append(texts(rig.replies(f"later {number}")))
    ages = ("", "11 min ago: ", "5 h ago: ", "3 d ago: ")
    assert replies == [[f"{age}Fence breached", f"{age}Failsafe: RTL"] for age in ages]


def test_losses_before_the_start_are_reported_to_every_later_peer(make_rig, texts):
    lost = [Event(Severity.WARNING, f"{name} is damaged") for name in ("mission.plan", "fence.plan")]
    rig = make_rig(addresses=("first",), start_events=lost)
    rig.tick(events=lost)
    for number in range(20):
        rig.tick(events=[Event(Severity.WARNING, f"warning {number}")])
    rig.transport.served = ("first", "later")
    rig.tick_silently()
    assert texts(rig.replies("later")) == [
        *(event.text for event in lost),
        *(f"warning {number}" for number in range(15, 20)),
    ]


def test_new_station_gets_all_losses_when_its_address_is_proven(make_rig, texts):
    lost = [Event(Severity.WARNING, f"{number}: {'x' * 45}") for number in range(10)]
    rig = make_rig(addresses=(), start_events=lost)
    assert texts(rig.prove()) == [event.text for event in lost]


def test_events_per_tick_are_limited(rig, texts):
    assert texts(rig.tick(events=[Event(Severity.INFO, str(n)) for n in range(1000)])) == list(map(str, range(16)))


def test_own_messages_get_no_reply(rig):
    rig.station.srcSystem, rig.station.srcComponent = 1, 1
    assert rig.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == []
    assert rig.request_handler.requests == []


def test_work_of_one_call_is_limited(rig, of):
    ping = rig.frame(mavlink.MAVLink_ping_message(1, 1, 0, 0))
    rig.transport.inbox.append(("station", ping * 500))
    rig.endpoint.service(0.0, [100])
    reply_count = len(of(rig.replies(), "PING"))
    assert reply_count == 4
    assert rig.endpoint.busy
    rig.finish()
    reply_count += len(of(rig.replies(), "PING"))
    assert reply_count == 500


@pytest.mark.parametrize(
    ("address", "size", "count", "calls"),
    [
        ("station", 64, 20, 5),  # 256 bytes in a call
        ("station", 1, 256, 1),
        ("station", 1, 257, 2),
        ("station", 320, 1, 1),
        ("station", 321, 1, 2),
        ("station", 255, 2, 1),
        ("unknown", 1, 20, 5),  # as much work as 64 bytes
        ("unknown", 321, 1, 1),
    ],
)
def test_bytes_that_one_call_searches_are_limited(rig, address, size, count, calls):
    rig.transport.inbox += [(address, bytes(size))] * count
    rig.endpoint.service(0.0, [100])
    assert 1 + rig.finish() == calls


def test_refused_bytes_are_counted_in_the_status(rig, of):
    rig.request_handler.values = rig.request_handler.values.replaced("LNK_MAVLINK1", 0)
    rig.tick()
    rig.give(b"noise", "stranger")
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    for _ in range(2):
        damaged = bytearray(rig.frame(beat))
        damaged[12] ^= 1
        rig.give(bytes(damaged))
    rig.give(beat.pack(rig.station, force_mavlink1=True) * 4)
    rig.tick()
    (status,) = of(rig.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS), "SYS_STATUS")
    assert status.errors_comm == 1 + 2 + 4


def test_notices_are_limited_to_four_and_then_one_in_thirty_seconds(rig, texts):
    rig.tick()
    for seconds, count in ((0.0, 4), (29.9, 0), (0.2, 1), (300.0, 4)):
        rig.now_s += seconds
        for _ in range(10):
            rig.endpoint.notify("link is full", rig.now_s)
        assert texts(rig.give(b"")) == ["link is full"] * count


def test_publish_replies_to_queued_frames(rig, of):
    ping = rig.frame(mavlink.MAVLink_ping_message(1, 1, 0, 0))
    rig.transport.inbox.append(("station", ping * 7))
    rig.endpoint.service(0.0, [100])
    reply_count = len(of(rig.replies(), "PING"))
    assert len(of(rig.tick(), "PING")) == 7 - reply_count > 0


def test_telemetry_fits_a_slow_line_and_every_message_is_sent(make_rig):
    rig = make_rig(byte_rate=120.0, has_radio_rates=True)
    seen, sent = set(), 0
    for _ in range(600):
        rig.tick_silently()
        sent += sum(len(data) for _, data in rig.transport.sent)
        seen |= {message.get_type() for message in rig.replies()}
    assert sent <= 120 * 60 + 280
    assert {"HEARTBEAT", "ATTITUDE", "SYS_STATUS", "GPS_RAW_INT", "SYSTEM_TIME", "NAMED_VALUE_FLOAT"} <= seen


def test_messages_that_stations_expect_are_sent_without_request(make_rig, of):
    """Home position (MAVSDK needs it for goto), fence status while there is a fence, landed state undefined."""
    rig = make_rig()
    rig.endpoint.service(0.0, [])
    known = {"home": Home(0.7, -0.2, 1.0), "mission": MissionReport(identities=(0, 7, 0))}
    replies = [message for _ in range(600) for message in rig.tick(**known)]
    for name, in_a_minute in (("HOME_POSITION", 12), ("EXTENDED_SYS_STATE", 12), ("FENCE_STATUS", 30)):
        assert len(of(replies, name)) == pytest.approx(in_a_minute, abs=1), name
    assert {message.landed_state for message in of(replies, "EXTENDED_SYS_STATE")} == {
        mavlink.MAV_LANDED_STATE_UNDEFINED
    }


def test_mavsummarize_reads_the_telemetry_log_of_a_station(make_rig, tmp_path):
    """A telemetry log contains the time in microseconds and the bytes of each frame."""
    script = shutil.which("mavsummarize.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavsummarize.py is not beside this Python")
    rig, north_rad = make_rig(), 1.0 / 6371e3
    rig.endpoint.service(0.0, [])
    with (tmp_path / "boat.tlog").open("wb") as file:
        for second in range(61):
            fix = PositionSample(second, FixType.FIX_3D, 0.6 + second * north_rad, 2.1, 2.0, 1.0, 0.0, 9, 0.9)
            for message in rig.tick(seconds=1.0, position=fix, position_ok=True, mode=Mode.AUTO, armed=True):
                file.write(struct.pack(">Q", round((1.7e9 + second) * 1e6)) + message.get_msgbuf())
    done = subprocess.run([sys.executable, script, file.name], capture_output=True, text=True, check=True)
    distance_m = float(re.search(r"^Total distance : ([\d.]+)m", done.stdout, re.MULTILINE)[1])
    assert distance_m == pytest.approx(60.0, rel=0.02)
    assert "Log started at about 2023-11-1" in done.stdout
    assert "Autonomous sections: 1\nAutonomous time (mm:ss):   1:0" in done.stdout


def test_critical_faults_are_in_the_heartbeat(rig, of):
    (beat,) = of(rig.tick(seconds=1.0, faults=1 << Fault.RUDDER_SILENT), "HEARTBEAT")
    assert beat.system_status == mavlink.MAV_STATE_CRITICAL


@pytest.mark.parametrize(("rate_hz", "early_s"), [(16.0, 0.03125), (2.0, 0.25), (0.5, 0.5)])
def test_message_may_be_half_a_tick_early(rig, of, rate_hz, early_s):
    """The tick is that of the loop, and counts as one second at most."""
    rig.now_s = 16.0
    rig.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 8e6)  # every 8 s
    assert of(rig.tick(seconds=0.0, rate_hz=rate_hz), "ATTITUDE")
    rig.now_s = 24.0
    assert of(rig.tick(seconds=-early_s - 0.001, rate_hz=rate_hz), "ATTITUDE") == []
    assert of(rig.tick(seconds=0.001, rate_hz=rate_hz), "ATTITUDE")


def test_key_of_a_late_disk_is_used_once(rig):
    content = b"key %s\ntimestamp 1\n" % KEY.hex().encode()
    assert rig.endpoint.restore_late_key(Stored(None, "no disk"))
    assert rig.endpoint.key_problem == "no disk"
    assert rig.endpoint.restore_late_key(Stored(content))
    assert rig.endpoint.key_problem == ""
    assert not rig.endpoint.restore_late_key(Stored(content))
    sign(rig)
    assert rig.send(mavlink.MAVLink_ping_message(1, 1, 0, 0))[0].get_msgbuf()[2] == 1  # signed
    assert rig.endpoint.progress() == ()


def test_transports_are_polled_and_are_flushed_and_closed_at_the_end(rig, of):
    rig.tick(seconds=5.0)
    assert rig.transport.polled_s == rig.now_s
    rig.transport.is_writable = False
    rig.send(mavlink.MAVLink_ping_message(1, 1, 0, 0))
    rig.transport.is_writable = True
    rig.endpoint.close()
    assert of(rig.replies(), "PING")
    assert rig.transport.closed


def test_endpoint_implements_the_interface(rig):
    link: Link = rig.endpoint
    assert list(link.descriptors()) == [100]


@pytest.mark.parametrize(
    ("options", "key", "signed", "counts"),
    [
        ("policy=auto", False, False, True),
        ("policy=auto", True, False, False),
        ("policy=open", True, False, False),
        ("policy=open", True, True, True),
        ("policy=signed-only", True, True, True),
        ("trusted=1", True, False, True),
    ],
)
def test_heartbeats_of_ground_stations_prevent_station_silent(make_rig, options, key, signed, counts):
    rig = make_rig(options=parse_options(options), addresses=())
    if key:
        assert rig.endpoint._signing.set_key(KEY, NOW)
    if signed:
        sign(rig)
    rig.prove()
    assert (rig.endpoint.station_s is not None) is counts


@pytest.mark.parametrize(
    ("sender", "kind", "options", "key", "counts"),
    [
        ((255, 190), GROUND_STATION, "policy=auto", False, True),
        ((255, 191), GROUND_STATION, "policy=auto", False, True),
        ((1, 191), GROUND_STATION, "policy=auto", False, False),
        ((1, 1), GROUND_STATION, "policy=auto", False, False),
        ((1, 191), GROUND_STATION, "trusted=1", False, False),
        ((1, 191), GROUND_STATION, "systems=255", False, False),
        ((1, 191), GROUND_STATION, "policy=auto", True, False),
        ((255, 190), ONBOARD_CONTROLLER, "policy=auto", False, False),
        ((254, 190), GROUND_STATION, "systems=255", False, False),
        ((254, 190), GROUND_STATION, "systems=254,255", False, True),
        ((254, 190), GROUND_STATION, "policy=signed-commands", False, False),
        ((254, 190), GROUND_STATION, "systems=255", True, False),
    ],
)
def test_only_a_commanding_station_prevents_station_silent(make_rig, sender, kind, options, key, counts):
    rig = make_rig(options=parse_options(options), addresses=())
    if key:
        assert rig.endpoint._signing.set_key(KEY, NOW)
        sign(rig)
    rig.station.srcSystem, rig.station.srcComponent = sender
    beat = mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 0, 3)
    rig.send(beat)
    rig.send(beat)
    assert (rig.endpoint.station_s is not None) is counts
    assert any(peer.ground_station for link in rig.endpoint.status(rig.now_s) for peer in link.peers) is counts


def test_reached_items_of_the_mission_are_reported(rig, of):
    rig.tick()
    (reached,) = of(rig.tick(mission=MissionReport(reached_items=(4,))), "MISSION_ITEM_REACHED")
    assert reached.seq == 5
    assert of(rig.tick(), "MISSION_ITEM_REACHED") == []


# --------------------------------------------------------------------------- on real lines


class Boat:
    """Serves an endpoint as the loop does, and polls a client in between."""

    def __init__(self, url, rig, open_line=None):
        self.endpoint = Endpoint(
            [open_transport(url, open_line)],
            rig.request_handler,
            utc_s=lambda: 0.0,
            version=Version(),
        )
        self.output = Output(RudderCommand(0.0, True), rig.endpoint._context.snapshot)
        self.tick = 0

    def serve(self, client, kind, turns=200):
        """Serve until the client has received a message of a kind."""
        for _ in range(turns):
            self.tick += 1
            self.endpoint.publish(self.output, self.tick * 0.1)
            ready, _, _ = select.select(self.endpoint.descriptors(), [], [], 0.01)
            self.endpoint.service(self.tick * 0.1, ready)
            found = client.recv_match(type=kind, blocking=False)
            while found is None and (other := client.recv_msg()) is not None:
                found = other if other.get_type() == kind else None
            if found is not None:
                return found
        pytest.fail(f"no {kind}")
        return None


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def closing():
    things = []
    yield things.append
    for thing in things:
        thing.close()


def converse(boat, client):
    """Exchange heartbeat, parameter and command with an independent client."""
    client.mav.heartbeat_send(6, 8, 0, 0, 0)
    assert boat.serve(client, "HEARTBEAT").type == mavlink.MAV_TYPE_SURFACE_BOAT
    client.mav.param_set_send(1, 1, b"CTL_K1", 42.5, mavlink.MAV_PARAM_TYPE_REAL32)
    assert boat.serve(client, "PARAM_VALUE").param_value == 42.5
    client.mav.command_long_send(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    assert boat.serve(client, "COMMAND_ACK").result == 0


@pytest.mark.parametrize(
    ("ours", "theirs", "kind"),
    [
        ("udpin", "udpout", socket.SOCK_DGRAM),
        ("udpout", "udpin", socket.SOCK_DGRAM),
        ("tcpin", "tcp", socket.SOCK_STREAM),
    ],
)
def test_independent_client_over_a_socket(rig, closing, ours, theirs, kind):
    port = free_port(kind)
    if ours == "udpout":
        client = mavutil.mavlink_connection(f"{theirs}:127.0.0.1:{port}", dialect="common")
        closing(client)
        boat = Boat(f"{ours}:127.0.0.1:{port}", rig)
        closing(boat.endpoint)
        boat.serve(client, "HEARTBEAT")  # the client learns the address from the first frame
    else:
        boat = Boat(f"{ours}:127.0.0.1:{port}", rig)
        closing(boat.endpoint)
        client = mavutil.mavlink_connection(f"{theirs}:127.0.0.1:{port}", dialect="common")
        closing(client)
    converse(boat, client)


class PtyLine:
    """The boat's end of a pseudo-terminal."""

    openings = 1
    connected = True

    def __init__(self, descriptor):
        self.name = os.ttyname(descriptor)
        self._descriptor = descriptor

    def fileno(self):
        return self._descriptor

    def read(self):
        try:
            return os.read(self._descriptor, 4096)
        except BlockingIOError:
            return b""

    def write(self, data):
        return os.write(self._descriptor, data) == len(data)


class PtyClient:
    """pymavlink at the other end."""

    def __init__(self, descriptor):
        self._descriptor = descriptor
        self._found = []
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self.mav.robust_parsing = True

    def write(self, data):
        os.write(self._descriptor, data)

    def recv_match(self, type, blocking):  # noqa: A002
        return None

    def recv_msg(self):
        try:
            self._found += self.mav.parse_buffer(os.read(self._descriptor, 4096)) or []
        except BlockingIOError:
            pass
        return self._found.pop(0) if self._found else None


def test_independent_client_over_a_serial_line(rig):
    boats, stations = os.openpty()
    try:
        for descriptor in (boats, stations):
            tty.setraw(descriptor)
            os.set_blocking(descriptor, False)
        boat = Boat("serial:/dev/ttyX:57600", rig, lambda _path, _baud: PtyLine(boats))
        converse(boat, PtyClient(stations))
        boat.endpoint.close()
    finally:
        os.close(boats)
        os.close(stations)


def test_power_saving_reduces_all_rates_except_heartbeats(rig, of):
    def received(**changes):
        replies = [message for _ in range(200) for message in rig.tick(**changes)]
        return len(of(replies, "ATTITUDE")), len(of(replies, "HEARTBEAT")), len(of(replies, "CURRENT_MODE"))

    attitudes, beats, modes = received()
    fewer, same, rare = received(power_saving_level=1)
    assert fewer == pytest.approx(attitudes / 5, abs=2)
    assert same == pytest.approx(beats, abs=1)
    assert rare < modes
    assert received()[0] == pytest.approx(attitudes, abs=2)
