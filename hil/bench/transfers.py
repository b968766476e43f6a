"""How fast parameters, missions and logs pass over a loopback link, beside what the loopback itself carries."""

from __future__ import annotations

import math
import random
import socket
import time

from pymavlink.dialects.v20 import common as dialect

from hil.bench.figure import Figure, Finding
from hil.bench.helper import background
from hil.bench.requester import Requester, walk
from hil.bench.sea import Sea
from hil.bench.setting import Setting
from hil.bench.spread import percentile
from hil.bench.steady import steady
from hil.bench.trips import echo
from hil.errors import HilError

ITEMS = 500
SEED = 1
LISTS = 10
SETTLE_S = 3.0
LOG_BYTES = 5_000_000
QUIET_S = 0.3
DATAGRAM_BYTES = 1200
DATAGRAMS = 5000
MOST_MISSION_S = 1.0
LEAST_LOG_MB_S = 5.0
_PARAM_VALUE, _COUNT, _REQUEST, _REQUEST_INT, _ITEM_INT, _ACK = 22, 44, 40, 51, 73, 47
_LOG_ENTRY, _LOG_DATA = 118, 120
_ITEM_SEQUENCE = 28  # its place in the payload
_LOG_PART = 90
_CHUNK_BYTES = 512 * _LOG_PART  # what QGroundControl and MAVSDK ask for at a time


def measure(setting: Setting) -> Finding:
    """List the parameters again and again, load a mission up and down, load a log."""
    port, directory = _free_port(), setting.directory / "transfers"
    with Sea(directory, links=(f"udpin:127.0.0.1:{port}",)) as sea:
        sea.listen(SETTLE_S)
        # Beside the log of this run, which is short.
        (directory / "state" / "logs" / "00000002.BIN").write_bytes(random.Random(SEED).randbytes(LOG_BYTES))
        station = Requester(port)
        try:
            with steady():
                count, list_s = _list(station)
                up_s, down_s = _upload(station), _download(station)
                log_bytes, log_s = _log(station)
            frame = station.pack(dialect.MAVLink_mission_request_int_message(1, 1, 0, 0))
        finally:
            station.close()
    with background("-m", "hil.bench.bare_echo", "udp") as (_, echo_port), steady():
        turn_s = echo(int(echo_port), frame, setting.trips).p50
    carried = _carried_mb_s()
    figures = (
        Figure("parameters listed", "1/s", count / list_s, peer="ArduRover 1200"),
        Figure(f"{ITEMS} mission items up", "s", up_s, ITEMS * turn_s, most=MOST_MISSION_S, peer="ArduRover 10"),
        Figure(f"{ITEMS} mission items down", "s", down_s, ITEMS * turn_s, most=MOST_MISSION_S, peer="ArduRover 10"),
        Figure("log download", "MB/s", log_bytes / log_s / 1e6, carried, least=LEAST_LOG_MB_S, peer="ArduRover 0.118"),
    )
    notes = (
        f"on loopback UDP; {count} parameters listed {LISTS} times, the median; a log of {log_bytes / 1e6:.2f} MB",
        f"bare, missions: {ITEMS} round trips to a Python process that sends each datagram back",
        f"bare, log: datagrams of {DATAGRAM_BYTES} bytes from one Python socket to another",
    )
    return Finding("Transfers", figures, notes)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _list(station: Requester) -> tuple[int, float]:
    """Return the number of parameters and the median time of a list in seconds."""
    frame = station.pack(dialect.MAVLink_param_request_list_message(1, 1))
    taken_s = []
    count = 0
    for _ in range(LISTS):
        rows: set[int] = set()
        start_s = time.monotonic()
        station.send(frame)
        for heard in station.listen(QUIET_S):
            if heard.number == _PARAM_VALUE:
                count = int.from_bytes(heard.payload[4:6], "little")
                rows.add(int.from_bytes(heard.payload[6:8], "little"))
                if len(rows) == count:
                    taken_s.append(time.monotonic() - start_s)
                    break
    if len(taken_s) < LISTS // 2:
        raise HilError(f"{LISTS - len(taken_s)} of {LISTS} parameter lists were not whole")
    return count, percentile(sorted(taken_s), 50.0)


def _upload(station: Requester) -> float:
    """Return the seconds for a mission, from its count to the acknowledgement; NaN when it is not taken."""
    items = [
        station.pack(
            dialect.MAVLink_mission_item_int_message(
                1, 1, row, 6, 16, 0, 1, 0, 0, 0, 0, 360000000 + 100 * row, 1210000000 + 100 * (row % 7), 0, 0
            )
        )
        for row in range(ITEMS)
    ]
    start_s = time.monotonic()
    frame = station.pack(dialect.MAVLink_mission_count_message(1, 1, ITEMS, 0))
    wanted = 0
    while True:

        def goes_on(number: int, payload: bytes, wanted: int = wanted) -> bool:
            asked = number in (_REQUEST, _REQUEST_INT) and int.from_bytes(payload[:2], "little") == wanted
            return asked or number == _ACK

        heard = station.ask(frame, lambda heard, goes_on=goes_on: goes_on(*heard))  # type: ignore[misc]
        if heard is None:
            return math.nan
        if heard.number == _ACK:
            accepted = heard.payload[2] == dialect.MAV_MISSION_ACCEPTED and wanted == ITEMS
            return time.monotonic() - start_s if accepted else math.nan
        frame = items[wanted]
        wanted += 1


def _download(station: Requester) -> float:
    """Return the seconds for a mission, from the request to the last item; NaN when it is not given."""
    asks = [station.pack(dialect.MAVLink_mission_request_int_message(1, 1, row, 0)) for row in range(ITEMS)]
    start_s = time.monotonic()
    frame = station.pack(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    heard = station.ask(frame, lambda heard: heard.number == _COUNT)
    if heard is None or int.from_bytes(heard.payload[:2], "little") != ITEMS:
        return math.nan
    for row, ask in enumerate(asks):
        wanted = row.to_bytes(2, "little")

        def is_it(number: int, payload: bytes, wanted: bytes = wanted) -> bool:
            return number == _ITEM_INT and payload[_ITEM_SEQUENCE : _ITEM_SEQUENCE + 2] == wanted

        if station.ask(ask, lambda heard, is_it=is_it: is_it(*heard)) is None:  # type: ignore[misc]
            return math.nan
    taken_s = time.monotonic() - start_s
    station.send(station.pack(dialect.MAVLink_mission_ack_message(1, 1, 0, 0)))
    return taken_s


def _log(station: Requester) -> tuple[int, float]:
    """Return how many bytes of a log were loaded, what was lost asked for again, and the seconds; NaN of none."""
    frame = station.pack(dialect.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    size_field = LOG_BYTES.to_bytes(4, "little")
    entry = station.ask(frame, lambda heard: heard.number == _LOG_ENTRY and heard.payload[4:8] == size_field)
    if entry is None:
        return 0, math.nan
    size, log = LOG_BYTES // _LOG_PART * _LOG_PART, int.from_bytes(entry.payload[8:10], "little")
    start_s = time.monotonic()
    for begin in range(0, size, _CHUNK_BYTES):
        if not _chunk(station, log, begin, min(begin + _CHUNK_BYTES, size)):
            return 0, math.nan
    return size, time.monotonic() - start_s


def _chunk(station: Requester, log: int, begin: int, end: int) -> bool:
    """Load a part of a log; return whether all of it came in the end."""
    missing = set(range(begin, end, _LOG_PART))
    while missing:
        before, first = len(missing), min(missing)
        station.send(station.pack(dialect.MAVLink_log_request_data_message(1, 1, log, first, end - first)))
        for heard in station.listen(QUIET_S):
            if heard.number == _LOG_DATA and heard.payload[6] == _LOG_PART:
                missing.discard(int.from_bytes(heard.payload[:4], "little"))
                if not missing:
                    break
        if len(missing) == before:
            return False
    return True


def _carried_mb_s() -> float:
    """Return what one Python socket takes from another, each datagram walked through as ours are."""
    data = b"\xfd\x5a\0\0\0\1\1\x78\0\0".ljust(102, b"\0") * (DATAGRAM_BYTES // 102)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker,
    ):
        taker.bind(("127.0.0.1", 0))
        sender.connect(taker.getsockname())
        start_s = time.monotonic()
        for _ in range(DATAGRAMS):
            sender.send(data)
            for _heard in walk(taker.recv(65536)):
                pass
        seconds = time.monotonic() - start_s
    return DATAGRAMS * len(data) / seconds / 1e6
