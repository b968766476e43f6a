"""Bytes sent to the forged address of one frame: counted on real sockets, over a minute."""

import select
import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.records import RudderCommand
from firmware_py.common.reports import Output
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.files.payload import Opcode
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import open_transport
from support.link import SNAPSHOT, FakeRequestHandler

MINUTE_S, TICK_S = 60.0, 0.5


def command(number, *values):
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *values, *(0.0,) * (7 - len(values)))


def file_request(opcode, size=0, data=b""):
    head = bytes((1, 0, 0, opcode, size, 0, 0, 0, 0, 0, 0, 0))
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list((head + data).ljust(251, b"\0")))


# Every short request with a long reply, and some with a short one.
REQUESTS = {
    "HEARTBEAT": mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
    "PING": mavlink.MAVLink_ping_message(1, 1, 0, 0),
    "TIMESYNC": mavlink.MAVLink_timesync_message(0, 1),
    "PARAM_REQUEST_READ": mavlink.MAVLink_param_request_read_message(1, 1, b"", 0),
    "PARAM_REQUEST_LIST": mavlink.MAVLink_param_request_list_message(1, 1),
    "PARAM_SET": mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 33.0, mavlink.MAV_PARAM_TYPE_REAL32),
    "MISSION_REQUEST_LIST": mavlink.MAVLink_mission_request_list_message(1, 1),
    "MISSION_COUNT": mavlink.MAVLink_mission_count_message(1, 1, 500, 0),
    "LOG_REQUEST_LIST": mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF),
    "LOG_REQUEST_DATA": mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF),
    "REQUEST_DATA_STREAM": mavlink.MAVLink_request_data_stream_message(1, 1, 0, 50, 1),
    "FTP list": file_request(Opcode.LIST),
    "FTP open": file_request(Opcode.OPEN_READ, 16, b"@PARAM/param.pck"),
    "FTP burst": file_request(Opcode.BURST_READ, 239),
    "all modes": command(mavlink.MAV_CMD_REQUEST_MESSAGE, 435, 0),  # AVAILABLE_MODES
    "MESSAGE_INTERVAL": command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 20_000),
    "version": command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    "arm": command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1),
    "unknown command": command(9999),
    "SETUP_SIGNING": mavlink.MAVLink_setup_signing_message(1, 1, bytes(range(32)), 1),
}


@pytest.fixture
def boat():
    """Return an endpoint on a UDP port of its own, and its address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endpoint = Endpoint(
        [open_transport(f"udpin:127.0.0.1:{port}", None)],
        FakeRequestHandler(),
        utc_s=lambda: 1.7e9,
        version=Version(),
    )
    yield endpoint, ("127.0.0.1", port)
    endpoint.close()


def bytes_in_a_minute(endpoint, end, since_s):
    """Simulate a minute and return the bytes received by a socket."""
    received_bytes = 0
    for turn in range(int(MINUTE_S / TICK_S)):
        now_s = since_s + turn * TICK_S
        if turn == 0:
            assert select.select(endpoint.descriptors(), [], [], 5.0)[0]
        endpoint.service(now_s, endpoint.descriptors())
        while endpoint.busy:
            endpoint.service(now_s, [])
        endpoint.publish(Output(RudderCommand(0.0, True), SNAPSHOT), now_s)
        while select.select([end], [], [], 0.0)[0]:
            received_bytes += len(end.recv(65536))
    return received_bytes


@pytest.mark.parametrize("name", [*REQUESTS, "all of them"])
def test_forged_frame_is_amplified_less_than_ten_times(boat, name):
    endpoint, address = boat
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    query = REQUESTS.values() if name == "all of them" else [REQUESTS[name]]
    frame = b"".join(message.pack(sender) for message in query)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.sendto(frame, address)
        received_bytes = bytes_in_a_minute(endpoint, end, 1.0)
    assert 0 < received_bytes < 10 * len(frame)


def test_one_forged_frame_per_minute_is_not_amplified_more(boat):
    """Earlier bytes to that address do not prove that a peer is there."""
    endpoint, address = boat
    frame = REQUESTS["PARAM_REQUEST_LIST"].pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        for minute in range(3):
            end.sendto(frame, address)
            assert bytes_in_a_minute(endpoint, end, 1.0 + minute * MINUTE_S) < 10 * len(frame)
