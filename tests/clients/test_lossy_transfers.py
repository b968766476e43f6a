"""Missions, files and logs over a link that loses, duplicates or delays a quarter of all datagrams.

The station is written from the pages of the protocols, independently of the code of the boat.
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


def create_items(count, seed):
    """Return positions and radii of mission items; item 0 is home, all others differ."""
    rng = random.Random(seed)
    return [
        (360_000_000 + rng.randrange(9_000_000), 1_210_000_000 + number, rng.randrange(1, 90))
        for number in range(count)
    ]


def upload(station, items):
    """Send the count, then the requested items until the acknowledgement; repeat the last message after a silence."""

    def send_count():
        station.mav.mission_count_send(1, 1, len(items), 0)

    def send_item(number):
        x, y, radius_m = items[number]
        station.mav.mission_item_int_send(1, 1, number, 6, 16, 0, 1, 0, radius_m, 0, 0, x, y, 0.0, 0)

    resend = send_count
    deadline_s = time.monotonic() + 6.0 * PATIENCE_S
    resend()
    while time.monotonic() < deadline_s:
        message = station.link.recv_match(type=["MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=SILENCE_S)
        if message is not None and message.get_type() == "MISSION_ACK":
            return message.type
        if message is not None:
            resend = functools.partial(send_item, message.seq)
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
    items = create_items(count, seed)
    assert upload(station, items) == mavlink.MAV_MISSION_ACCEPTED
    assert download(station)[1:] == items[1:]


# ----------------------------------------------------------------------------------- files


class Files:
    """A client of the file transfer protocol: each request has its own number and is repeated until its reply."""

    def __init__(self, station):
        self._station = station
        self._number = 0

    def request(self, opcode, data=b"", *, session=0, offset=0, size=None):
        """Send a request until it has a reply; return opcode, session and data of the reply."""
        self._number = (self._number + 1) % 65536
        length = len(data) if size is None else size
        payload = FTP.pack(self._number, session, opcode, length, 0, 0, 0, offset, data)

        def send():
            self._station.mav.file_transfer_protocol_send(0, 1, 1, payload)

        def is_reply(message):
            number, _, kind, _, request_opcode, *_ = FTP.unpack(bytes(message.payload))
            return number == (self._number + 1) % 65536 and kind in (ACK, NAK) and request_opcode == opcode

        message = request_reply(self._station, send, "FILE_TRANSFER_PROTOCOL", is_reply)
        _, session, kind, length, *_, content = FTP.unpack(bytes(message.payload))
        return kind, session, content[:length]

    def get(self, path):
        """Return the content of a file: request a burst, then each missing piece."""
        kind, session, size = self.request(OPEN_READ, path.encode())
        assert kind == ACK, path
        (size,) = struct.unpack("<I", size)
        pieces = self._burst(session, size)
        content = bytearray(size)
        offset = 0
        while offset < size:
            piece = pieces.get(offset)
            if piece is None:
                kind, _, piece = self.request(READ, session=session, offset=offset, size=min(239, size - offset))
                assert kind == ACK
            content[offset : offset + len(piece)] = piece
            offset += len(piece)
        self.request(TERMINATE, session=session)
        return bytes(content)

    def _burst(self, session, size):
        """Return the received pieces of a burst from the beginning of the file, by their offsets."""
        self._number = (self._number + 1) % 65536
        begin = FTP.pack(self._number, session, BURST_READ, 239, 0, 0, 0, 0, b"")
        pieces = {}

        def is_piece(message):
            _, _, kind, length, request_opcode, _, _, offset, content = FTP.unpack(bytes(message.payload))
            if kind == ACK and request_opcode == BURST_READ:
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
        """Send a file in pieces; return the checksum that the autopilot computes."""
        kind, session, _ = self.request(CREATE, path.encode())
        assert kind == ACK, path
        for offset in range(0, len(content), 239):
            kind, *_ = self.request(WRITE, content[offset : offset + 239], session=session, offset=offset)
            assert kind == ACK
        assert self.request(TERMINATE, session=session)[0] == ACK
        kind, _, checksum = self.request(CHECKSUM, path.encode())
        assert kind == ACK
        return struct.unpack("<I", checksum)[0]


def check_files(station, tmp_path):
    files = Files(station)
    assert files.get("/logs/00000001.BIN") == log_bytes(tmp_path / "state", 1)
    sent = random.Random(11).randbytes(UPLOAD_BYTES)
    # The CRC-32 of the protocol has the initial value 0 and is not inverted.
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
        lambda entry: entry.id == 1,
    )
    assert entry.size == len(log_bytes(tmp_path / "state", 1))
    data_by_offset = {}
    deadline_s = time.monotonic() + 3.0 * PATIENCE_S
    while (missing := missing_ranges(data_by_offset, entry.size)) and time.monotonic() < deadline_s:
        start, end = missing[0]
        station.mav.log_request_data_send(1, 1, 1, start, end - start)
        while (row := station.link.recv_match(type="LOG_DATA", blocking=True, timeout=RETRY_S)) is not None:
            if row.id == 1:
                data_by_offset[row.ofs] = bytes(row.data[: row.count])
    station.mav.log_request_end_send(1, 1)
    assert b"".join(data for _, data in sorted(data_by_offset.items())) == log_bytes(tmp_path / "state", 1)


def missing_ranges(offsets, size):
    """Return the ranges of a log that were not received, as [start, end)."""
    rows = []
    for start in range(0, size, LOG_BLOCK):
        if start in offsets:
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
