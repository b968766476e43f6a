"""A minimal ground station on a UDP link."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from hil.sim.ground_station import COMPONENT, SYSTEM
from hil.sim.mavlink_tap import MavlinkTap

HEARTBEAT_S = 1.0
READ_BYTES = 4096
RECEIVED_NUMBERS = (
    dialect.MAVLINK_MSG_ID_HEARTBEAT,
    dialect.MAVLINK_MSG_ID_PARAM_VALUE,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
)


class Station:
    """A ground station on a loopback port of its own; close it."""

    def __init__(self) -> None:
        """Open the port."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._tap = MavlinkTap(RECEIVED_NUMBERS)
        self._sender = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._peer: tuple[str, int] | None = None
        self._next_heartbeat_s = 0.0

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    @property
    def url(self) -> str:
        """The URL of the link for the autopilot."""
        return f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"

    def await_message(self, timeout_s: float, matches: Callable[[Any], bool]) -> float | None:
        """Return when (monotonic) the datagram with the first matching message arrived; None after the timeout.

        It sends heartbeats while it waits.
        """
        deadline_s = time.monotonic() + timeout_s
        while (now_s := time.monotonic()) < deadline_s:
            self._send_heartbeat(now_s)
            until_s = min(deadline_s, self._next_heartbeat_s) if self._peer else deadline_s
            if not select.select([self._socket], [], [], max(0.0, until_s - now_s))[0]:
                continue
            received_s = time.monotonic()
            if any(matches(message) for message in self.receive()):
                return received_s
        return None

    def await_heartbeat(self, timeout_s: float) -> float | None:
        """Return when the autopilot's heartbeat arrived, or None."""
        return self.await_message(timeout_s, lambda message: message.get_type() == "HEARTBEAT")

    def listen(self, seconds: float) -> None:
        """Receive for this time."""
        self.await_message(seconds, lambda _message: False)

    def fileno(self) -> int:
        """Return the descriptor to wait for before `receive`."""
        return self._socket.fileno()

    def receive(self) -> list[Any]:
        """Read a datagram; return its messages with RECEIVED_NUMBERS."""
        data, self._peer = self._socket.recvfrom(READ_BYTES)
        return list(self._tap.feed(data))

    def pack(self, message: Any) -> bytes:
        """Return a message as a frame of this station."""
        frame = bytes(message.pack(self._sender))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame

    def send(self, frame: bytes) -> float:
        """Send a frame to the last sender and return the time (monotonic)."""
        sent_s = time.monotonic()
        if self._peer is not None:
            self._socket.sendto(frame, self._peer)
        return sent_s

    def _send_heartbeat(self, now_s: float) -> None:
        if self._peer is not None and now_s >= self._next_heartbeat_s:
            self._next_heartbeat_s = now_s + HEARTBEAT_S
            mav_type, autopilot, state = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, dialect.MAV_STATE_ACTIVE
            self.send(self.pack(dialect.MAVLink_heartbeat_message(mav_type, autopilot, 0, 0, state, 3)))
