"""Missions, files and logs through a link that loses, doubles and delays a quarter: complete and correct.

The station here is written after the protocols' own pages, apart from the boat's code.
"""

import functools
import random
import struct
import time
import zlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from support.paths import log_bytes
from support.relay import RETRY_S, check_losses, request_reply
from support.station import PATIENCE_S

SEEDS = [1, 2, 3]
SILENCE_S = 1.0  # longer than the autopilot waits before it repeats a request
LOG_BLOCK = 90
UPLOAD_BYTES = 3000
NONE, TERMINATE, OPEN_READ, READ, CREATE, WRITE, CHECKSUM, BURST_READ = 0, 1, 4, 5, 6, 7, 14, 15
ACK, NAK = 128, 129
END_OF_FILE = 6
FTP = struct.Struct("<HBBBBBBI239s")


# -------------------------------------------------------------------------------- missions


def items(count, seed):
    """Item 0 is home; all others differ."""
    chances = random.Random(seed)
    return [
        (360_000_000 + chances.randrange(9_000_000), 1_210_000_000 + number, chances.randrange(1, 90))
        for number in range(count)
    ]


def upload(station, places):
    """Send the count, then the requested items until the acknowledgement; repeat the last message after a silence."""

    def count():
        station.mav.mission_count_send(1, 1, len(places), 0)

    def give(number):
        x, y, radius_m = places[number]
        station.mav.mission_item_int_send(1, 1, number, 6, 16, 0, 1, 0, radius_m, 0, 0, x, y, 0.0, 0)

    resend = count
    give_up_s = time.monotonic() + 6.0 * PATIENCE_S
    resend()
    while time.monotonic() < give_up_s:
        message = station.link.recv_match(type=["MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=SILENCE_S)
        if message is not None and message.get_type() == "MISSION_ACK":
            return message.type
        if message is not None:
            resend = functools.partial(give, message.seq)
        resend()
    return pytest.fail("the mission was not acknowledged")


def download(station):
    count = request_reply(station, lambda: station.mav.mission_request_list_send(1, 1, 0), "MISSION_COUNT").count
    rows = [
        request_reply(
            station,
            lambda number=number: station.mav.mission_request_int_send(1, 1, number, 0),
            "MISSION_ITEM_INT",
            lambda item, number=number: item.seq == number,
        )
        for number in range(count)
    ]
    station.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED, 0)
    return [(row.x, row.y, round(row.param2)) for row in rows]


def check_mission(station, count, seed):
    places = items(count, seed)
    assert upload(station, places) == mavlink.MAV_MISSION_ACCEPTED
    assert download(station)[1:] == places[1:]


# ----------------------------------------------------------------------------------- files


class Files:
    """A client of file transfer: each request has its own number, and is repeated until it is answered."""

    def __init__(self, station):
        self._station = station
        self._number = 0

    def request(self, opcode, data=b"", *, session=0, offset=0, size=None):
        """Ask until it is answered; returns the answer's opcode, session, data."""
        self._number = (self._number + 1) % 65536
        length = len(data) if size is None else size
        payload = FTP.pack(self._number, session, opcode, length, 0, 0, 0, offset, data)

        def ask():
            self._station.mav.file_transfer_protocol_send(0, 1, 1, payload)

        def ours(message):
            number, _, kind, _, of, *_ = FTP.unpack(bytes(message.payload))
            return number == (self._number + 1) % 65536 and kind in (ACK, NAK) and of == opcode

        message = request_reply(self._station, ask, "FILE_TRANSFER_PROTOCOL", ours)
        _, session, kind, length, *_, content = FTP.unpack(bytes(message.payload))
        return kind, session, content[:length]

    def get(self, path):
        """Fetch a file: bursts first, and then what is missing, piece by piece."""
        kind, session, size = self.request(OPEN_READ, path.encode())
        assert kind == ACK, path
        (size,) = struct.unpack("<I", size)
        pieces = self._burst(session, size)
        got = bytearray(size)
        at = 0
        while at < size:
            piece = pieces.get(at)
            if piece is None:
                kind, _, piece = self.request(READ, session=session, offset=at, size=min(239, size - at))
                assert kind == ACK
            got[at : at + len(piece)] = piece
            at += len(piece)
        self.request(TERMINATE, session=session)
        return bytes(got)

    def _burst(self, session, size):
        """Whatever comes of a burst from the beginning of the file; the pieces by their offsets."""
        self._number = (self._number + 1) % 65536
        begin = FTP.pack(self._number, session, BURST_READ, 239, 0, 0, 0, 0, b"")
        pieces = {}

        def is_piece(message):
            _, _, kind, length, of, _, _, offset, content = FTP.unpack(bytes(message.payload))
            if kind == ACK and of == BURST_READ:
                pieces[offset] = content[:length]
                return True
            return False

        request_reply(
            self._station,
            lambda: self._station.mav.file_transfer_protocol_send(0, 1, 1, begin),
            "FILE_TRANSFER_PROTOCOL",
            is_piece,
        )
        while sum(map(len, pieces.values())) < size:
            message = self._station.link.recv_match(type="FILE_TRANSFER_PROTOCOL", blocking=True, timeout=RETRY_S)
            if message is None:
                break
            is_piece(message)
        return pieces

    def put(self, path, content):
        """Send a file, piece by piece; return the checksum that the autopilot computes."""
        kind, session, _ = self.request(CREATE, path.encode())
        assert kind == ACK, path
        for at in range(0, len(content), 239):
            kind, *_ = self.request(WRITE, content[at : at + 239], session=session, offset=at)
            assert kind == ACK
        assert self.request(TERMINATE, session=session)[0] == ACK
        kind, _, sum_of_it = self.request(CHECKSUM, path.encode())
        assert kind == ACK
        return struct.unpack("<I", sum_of_it)[0]


def check_files(station, tmp_path):
    files = Files(station)
    assert files.get("/logs/00000001.BIN") == log_bytes(tmp_path / "state", 1)
    sent = random.Random(11).randbytes(UPLOAD_BYTES)
    # The CRC32 of the protocol begins at 0 and is not inverted in the end.
    assert files.put("/uploads/up.bin", sent) == ~zlib.crc32(sent, 0xFFFFFFFF) & 0xFFFFFFFF
    assert (tmp_path / "state" / "uploads" / "up.bin").read_bytes() == sent
    assert files.get("/uploads/up.bin") == sent


# ------------------------------------------------------------------------------------ logs


def log_path(tmp_path):
    return tmp_path / "state" / "logs" / "00000001.BIN"


def check_logs(station, tmp_path):
    entry = request_reply(
        station,
        lambda: station.mav.log_request_list_send(1, 1, 1, 1),
        "LOG_ENTRY",
        lambda one: one.id == 1,
    )
    assert entry.size == len(log_bytes(tmp_path / "state", 1))
    found = {}
    give_up_s = time.monotonic() + 3.0 * PATIENCE_S
    while (missing := holes(found, entry.size)) and time.monotonic() < give_up_s:
        start, end = missing[0]
        station.mav.log_request_data_send(1, 1, 1, start, end - start)
        while (row := station.link.recv_match(type="LOG_DATA", blocking=True, timeout=RETRY_S)) is not None:
            if row.id == 1:
                found[row.ofs] = bytes(row.data[: row.count])
    station.mav.log_request_end_send(1, 1)
    assert b"".join(found[at] for at in sorted(found)) == log_bytes(tmp_path / "state", 1)


def holes(found, size):
    """The stretches of a log that have not come, as [start, end)."""
    rows = []
    for start in range(0, size, LOG_BLOCK):
        if start in found:
            continue
        if rows and rows[-1][1] == start:
            rows[-1][1] = start + LOG_BLOCK
        else:
            rows.append([start, start + LOG_BLOCK])
    return [(start, min(end, size)) for start, end in rows]


def check_all(lossy, tmp_path, seed, *, count, log_bytes):
    log_path(tmp_path).parent.mkdir(parents=True)
    log_path(tmp_path).write_bytes(random.Random(seed).randbytes(log_bytes))
    relay, station = lossy(seed)
    check_mission(station, count, seed)
    check_files(station, tmp_path)
    check_logs(station, tmp_path)
    check_losses(relay)


def test_missions_files_and_logs_over_a_lossy_link(lossy, tmp_path):
    check_all(lossy, tmp_path, SEEDS[0], count=25, log_bytes=10_000)


@pytest.mark.proof
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", SEEDS)
def test_500_items_files_and_logs_over_a_lossy_link(lossy, tmp_path, seed):
    check_all(lossy, tmp_path, seed, count=500, log_bytes=60_000)
