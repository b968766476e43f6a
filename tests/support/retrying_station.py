"""A ground station that repeats each request until there is a reply."""

import socket
import time
from functools import partial

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from support.program import unused_ports
from support.station import PATIENCE_S

REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
ACCEPTED, IN_PROGRESS = 0, 5
RETRY_S = 0.5


class RetryingStation:
    """A ground station that repeats each request until there is a reply."""

    def __init__(self):
        self.end_reason = lambda: ""  # not empty after the end of the autopilot

    def connect(self):
        """Open a new socket for the next autopilot; return its port."""
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.mav.robust_parsing = True
        # A new port for each start, because another program may have opened the old one.
        (port,) = unused_ports(["udpin"])
        self.address = ("127.0.0.1", port)
        return port

    def send(self, message):
        self.socket.sendto(message.pack(self.mav), self.address)
        self.mav.seq = (self.mav.seq + 1) % 256

    def messages(self):
        """Return the messages that arrive within 20 ms."""
        self.socket.settimeout(0.02)
        try:
            return self.mav.parse_buffer(self.socket.recv(65536)) or []
        except (TimeoutError, ConnectionRefusedError):
            return []

    def ask(self, request, read):
        """Send messages until there is a reply for which `read` returns a value; return that."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            for message in request:
                self.send(message)
            if reason := self.end_reason():
                pytest.fail(reason)
            retry_s = time.monotonic() + RETRY_S
            while time.monotonic() < retry_s:
                for message in self.messages():
                    if (value := read(message)) is not None:
                        return value
        return pytest.fail(f"no answer to {request}")

    def command(self, number, *values):
        values = (*values, *(0.0,) * (7 - len(values)))
        return [mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)]

    def request(self, number):
        """Request a message; it is sent after the first tick."""
        return self.ask(
            self.command(REQUEST, number), lambda message: message if message.get_msgId() == number else None
        )

    def upload(self, places):
        """Send a mission of waypoints (x, y) [1e-7 deg].

        It is a generator that ends at the acknowledgement and returns whether the mission is accepted.
        """
        items = [(0, 0), *places]
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            for message in self.messages():
                name = message.get_type()
                if name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    x, y = items[message.seq]
                    frame, command = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT
                    fields = (1, 1, message.seq, frame, command, 0, 1, 0.0, 0.0, 0.0, 0.0, x, y, 0.0)
                    self.send(mavlink.MAVLink_mission_item_int_message(*fields))
                elif name == "MISSION_ACK":
                    return message.type == ACCEPTED
            yield
        return pytest.fail("the upload is not acknowledged")

    def download(self):
        count = self.ask(
            [mavlink.MAVLink_mission_request_list_message(1, 1)],
            lambda message: message.count if message.get_type() == "MISSION_COUNT" else None,
        )

        def position_of(message, number):
            is_item = message.get_type() == "MISSION_ITEM_INT" and message.seq == number
            return (message.x, message.y) if is_item else None

        requests = {n: mavlink.MAVLink_mission_request_int_message(1, 1, n) for n in range(1, count)}
        return tuple(self.ask([message], partial(position_of, number=n)) for n, message in requests.items())


def send_once(station, request, number):
    """Send a command once; a generator that ends at the acknowledgement and returns whether it is accepted."""
    for message in request:
        station.send(message)
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        for reply in station.messages():
            if reply.get_type() == "COMMAND_ACK" and reply.command == number and reply.result != IN_PROGRESS:
                return reply.result == ACCEPTED
        yield
    return pytest.fail(f"command {number} is not acknowledged")
