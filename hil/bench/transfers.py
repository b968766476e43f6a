"""Duration of parameter and mission transfers over a loopback link."""

from __future__ import annotations

import math
import select
import socket
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as dialect

from hil.bench.background_run import BackgroundRun
from hil.bench.figure import Figure, Finding
from hil.bench.machine import autopilot_scheduling
from hil.bench.setting import Setting
from hil.errors import HilError

ITEMS = 500
LISTS = 10  # number of times that the parameters are listed
SETTLE_S = 3.0  # after the start of the autopilot
QUIET_S = 0.3  # time without a message that ends a list
MAX_MISSION_S = 1.0
SYSTEM, COMPONENT = 252, dialect.MAV_COMP_ID_MISSIONPLANNER
RETRY_S = 0.25
RETRIES = 20
BUFFER_BYTES = 1 << 22  # the system may grant less
_PARAM_VALUE = dialect.MAVLINK_MSG_ID_PARAM_VALUE
_COUNT, _ACK = dialect.MAVLINK_MSG_ID_MISSION_COUNT, dialect.MAVLINK_MSG_ID_MISSION_ACK
_REQUEST, _REQUEST_INT = dialect.MAVLINK_MSG_ID_MISSION_REQUEST, dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT
_ITEM_INT = dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT
_ITEM_SEQUENCE = 28  # its offset in the payload
_READ_BYTES = 65536
_HEADER, _CHECKSUM, _SIGNATURE = 10, 2, 13
_MARKER = 0xFD
_MAX_PAYLOAD = 255


def measure(setting: Setting) -> Finding:
    """List the parameters several times, upload a mission and download it."""
    port = _free_port()
    with BackgroundRun(setting.directory / "transfers", links=(f"udpin:127.0.0.1:{port}",)) as background_run:
        background_run.listen(SETTLE_S)
        station = Requester(port)
        try:
            with autopilot_scheduling():
                count, list_s = _list_parameters(station)
                up_s, down_s = _upload(station), _download(station)
        finally:
            station.close()
    figures = (
        Figure("parameters listed", "1/s", count / list_s, peer="ArduRover 1200"),
        Figure(f"{ITEMS} mission items up", "s", up_s, maximum=MAX_MISSION_S, peer="ArduRover 10"),
        Figure(f"{ITEMS} mission items down", "s", down_s, maximum=MAX_MISSION_S, peer="ArduRover 10"),
    )
    notes = (f"on loopback UDP; {count} parameters listed {LISTS} times, the median",)
    return Finding("Transfers", figures, notes)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _list_parameters(station: Requester) -> tuple[int, float]:
    """Return the number of parameters and the median time of a list in seconds."""
    frame = station.pack(dialect.MAVLink_param_request_list_message(1, 1))
    durations_s = []
    count = 0
    for _ in range(LISTS):
        rows: set[int] = set()
        start_s = time.monotonic()
        station.send(frame)
        for message in station.listen(QUIET_S):
            if message.number == _PARAM_VALUE:
                count = int.from_bytes(message.payload[4:6], "little")
                rows.add(int.from_bytes(message.payload[6:8], "little"))
                if len(rows) == count:
                    durations_s.append(time.monotonic() - start_s)
                    break
    if len(durations_s) < LISTS // 2:
        raise HilError(f"{LISTS - len(durations_s)} of {LISTS} parameter lists were incomplete")
    return count, statistics.median(durations_s)


def _upload(station: Requester) -> float:
    """Return the time in seconds from the count of a mission to its acknowledgement; NaN if it is not accepted."""
    waypoint = (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, dialect.MAV_CMD_NAV_WAYPOINT)
    items = [
        station.pack(
            dialect.MAVLink_mission_item_int_message(
                1, 1, row, *waypoint, 0, 1, 0, 0, 0, 0, 360000000 + 100 * row, 1210000000 + 100 * (row % 7), 0, 0
            )
        )
        for row in range(ITEMS)
    ]
    start_s = time.monotonic()
    frame = station.pack(dialect.MAVLink_mission_count_message(1, 1, ITEMS, 0))
    row = 0
    while True:

        def matches(message: Message, row: int = row) -> bool:
            is_request = message.number in (_REQUEST, _REQUEST_INT)
            return message.number == _ACK or (is_request and int.from_bytes(message.payload[:2], "little") == row)

        reply = station.request(frame, matches)
        if reply is None:
            return math.nan
        if reply.number == _ACK:
            is_accepted = reply.payload[2] == dialect.MAV_MISSION_ACCEPTED and row == ITEMS
            return time.monotonic() - start_s if is_accepted else math.nan
        frame = items[row]
        row += 1


def _download(station: Requester) -> float:
    """Return the time in seconds from the request of a mission to its last item; NaN if it is incomplete."""
    requests = [station.pack(dialect.MAVLink_mission_request_int_message(1, 1, row, 0)) for row in range(ITEMS)]
    start_s = time.monotonic()
    frame = station.pack(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    reply = station.request(frame, lambda message: message.number == _COUNT)
    if reply is None or int.from_bytes(reply.payload[:2], "little") != ITEMS:
        return math.nan
    for row, request in enumerate(requests):

        def matches(message: Message, row: bytes = row.to_bytes(2, "little")) -> bool:
            sequence = message.payload[_ITEM_SEQUENCE : _ITEM_SEQUENCE + 2]
            return message.number == _ITEM_INT and sequence == row

        if station.request(request, matches) is None:
            return math.nan
    duration_s = time.monotonic() - start_s
    station.send(station.pack(dialect.MAVLink_mission_ack_message(1, 1, 0, 0)))
    return duration_s


class Message(NamedTuple):
    """A received message: its number, and its payload with trailing zeros."""

    number: int
    payload: bytes


class Requester:
    """A ground station on a `udpin` link that sends each request immediately after the last reply."""

    def __init__(self, port: int) -> None:
        """Open a socket to the link."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._socket.connect(("127.0.0.1", port))
        self._sender = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def pack(self, message: Any) -> bytes:
        """Return a message as a frame of this station."""
        return bytes(message.pack(self._sender))

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.send(frame)

    def listen(self, seconds: float) -> Iterator[Message]:
        """Yield messages until none arrives within this time."""
        while select.select([self._socket], [], [], seconds)[0]:
            yield from parse_datagram(self._socket.recv(_READ_BYTES))

    def request(self, frame: bytes, matches: Callable[[Message], bool]) -> Message | None:
        """Send a frame and repeat it until a reply arrives; return the reply, or None."""
        for _ in range(RETRIES):
            self.send(frame)
            end_s = time.monotonic() + RETRY_S
            while (remaining_s := end_s - time.monotonic()) > 0.0:
                if not select.select([self._socket], [], [], remaining_s)[0]:
                    break
                for message in parse_datagram(self._socket.recv(_READ_BYTES)):
                    if matches(message):
                        return message
        return None


def parse_datagram(data: bytes) -> Iterator[Message]:
    """Yield the MAVLink 2 messages of a datagram; the sender is trusted, so checksums are not verified."""
    offset = 0
    while offset + _HEADER <= len(data) and data[offset] == _MARKER:
        size = data[offset + 1]
        number = int.from_bytes(data[offset + 7 : offset + 10], "little")
        start = offset + _HEADER
        yield Message(number, data[start : start + size].ljust(_MAX_PAYLOAD, b"\0"))
        offset = start + size + _CHECKSUM + (_SIGNATURE if data[offset + 2] & 1 else 0)
