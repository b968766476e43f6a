"""A ground station that asks until it is answered, and believes every acknowledgement."""

import socket
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from support.program import unused_ports
from support.station import PATIENCE_S

REQUEST = 512
ACCEPTED, IN_PROGRESS = 0, 5
AGAIN_S = 0.5


class AskingStation:
    """A ground station that believes every acknowledgement."""

    def __init__(self):
        self.gone = lambda: ""  # says how the autopilot has ended, if it has

    def connect(self):
        """Forget what the last autopilot has said; return the port of the next one."""
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.mav.robust_parsing = True
        # Another one each time: between two starts anybody may take it.
        (port,) = unused_ports(["udpin"])
        self.address = ("127.0.0.1", port)
        return port

    def send(self, message):
        self.socket.sendto(message.pack(self.mav), self.address)
        self.mav.seq = (self.mav.seq + 1) % 256

    def messages(self):
        """Return the messages that arrive within a moment."""
        self.socket.settimeout(0.02)
        try:
            return self.mav.parse_buffer(self.socket.recv(65536)) or []
        except (TimeoutError, ConnectionRefusedError):
            return []

    def ask(self, question, wanted):
        """Ask until an answer comes for which `wanted` returns something, and return that."""
        give_up_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up_s:
            for message in question:
                self.send(message)
            if reason := self.gone():
                pytest.fail(reason)
            again_s = time.monotonic() + AGAIN_S
            while time.monotonic() < again_s:
                for message in self.messages():
                    if (found := wanted(message)) is not None:
                        return found
        return pytest.fail(f"no answer to {question}")

    def command(self, number, *values):
        values = (*values, *(0.0,) * (7 - len(values)))
        return [mavlink.MAVLink_command_long_message(1, 1, number, 0, *values)]

    def request(self, number):
        """Ask for a message; it comes once there was a tick."""
        return self.ask(self.command(REQUEST, number), lambda one: one if one.get_msgId() == number else None)

    def upload(self, places):
        """Send a mission; a generator that is through when it is acknowledged."""
        items = [(0, 0), *places]
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        give_up_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up_s:
            for message in self.messages():
                kind = message.get_type()
                if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    x, y = items[message.seq]
                    fields = (1, 1, message.seq, 6, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, x, y, 0.0)
                    self.send(mavlink.MAVLink_mission_item_int_message(*fields))
                elif kind == "MISSION_ACK":
                    return message.type == ACCEPTED
            yield
        return pytest.fail("no end of an upload")

    def download(self):
        count = self.ask(
            [mavlink.MAVLink_mission_request_list_message(1, 1)],
            lambda one: one.count if one.get_type() == "MISSION_COUNT" else None,
        )

        def place(number):
            return self.ask(
                [mavlink.MAVLink_mission_request_int_message(1, 1, number)],
                lambda one: (one.x, one.y) if one.get_type() == "MISSION_ITEM_INT" and one.seq == number else None,
            )

        return tuple(place(number) for number in range(1, count))


def answered(station, question, number):
    """Send a command once; through when its answer has come."""
    for message in question:
        station.send(message)
    give_up_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < give_up_s:
        for one in station.messages():
            if one.get_type() == "COMMAND_ACK" and one.command == number and one.result != IN_PROGRESS:
                return one.result == ACCEPTED
        yield
    return pytest.fail(f"command {number} is not acknowledged")
