"""Writes seeded bytes to a link at a given rate, with one kind of content after another.

`python flood.py udp|tcp PORT SECONDS` or `python flood.py pty DESCRIPTOR SECONDS` prints the number of bytes that the
link accepted, as JSON. `python flood.py disk DIRECTORY SECONDS` writes to a file, waits for the disk after each write,
and prints the number of written bytes.
"""

import errno
import json
import os
import random
import select
import socket
import sys
import tempfile
import time

from pymavlink.dialects.v20 import common as mavlink

BYTES_PER_S = 10e6
PIECE_BYTES = 1400
STEP_S = 0.005
CONTENT_S = 2.0  # duration of one kind of content
SOURCES = 20  # UDP ports that send; more than the boat has peer slots
SEED = 4
DISK_PIECE, DISK_PIECES = b"\xa5" * (4 << 20), 16  # then the file is overwritten from its beginning


def frames(messages, systems=(255,)):
    """Return the frames of the messages, sent by each of the systems in turn."""
    encoded = []
    for number, message in enumerate(messages):
        station = mavlink.MAVLink(None, srcSystem=systems[number % len(systems)], srcComponent=190)
        station.seq = number % 256
        encoded.append(message.pack(station))
    return encoded


def join_frames(encoded, rng):
    """Return pieces of whole frames in random order."""
    pieces = []
    for _ in range(32):
        piece = b""
        while len(piece) < PIECE_BYTES - 280:
            piece += rng.choice(encoded)
        pieces.append(piece)
    return pieces


def noise(rng):
    return [rng.randbytes(PIECE_BYTES) for _ in range(64)]


def false_frames(rng):
    """Return dense headers of the longest frames: each fifth byte begins a checksum over 260 bytes."""
    crafted = b"\xfd\xff\x00\x00\x00" * (PIECE_BYTES // 5)
    markers = [bytes(rng.choice((0xFD, 0xFE, 0, 1)) for _ in range(PIECE_BYTES)) for _ in range(16)]
    return [crafted, *markers]


def mixed_requests(rng):
    requests = [
        mavlink.MAVLink_param_request_list_message(1, 1),
        mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
        mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0),
        mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF),
        mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF),
        mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [0, 0, 0, 3, 1, 0, 0, 0, 0, 0, 0, 0, 47, *[0] * 238]),
        mavlink.MAVLink_ping_message(1, 1, 0, 0),
        mavlink.MAVLink_timesync_message(0, 1),
    ]
    return join_frames(frames(requests), rng)


def parameter_lists(rng):
    return join_frames(frames([mavlink.MAVLink_param_request_list_message(1, 1)] * 4), rng)


def commands(rng):
    numbers = (176, 400, 410, 511, 512, 519, 520, 401, 115, 21196, 31010)
    requests = [
        mavlink.MAVLink_command_long_message(1, 1, number, rng.randrange(2), *values)
        for number in numbers
        for values in ([0.0] * 7, [rng.uniform(-1e3, 1e3) for _ in range(7)], [435.0, 0, 0, 0, 0, 0, 0])
    ]
    requests += [
        mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", rng.uniform(0, 300), 9),
        mavlink.MAVLink_mission_count_message(1, 1, 60000, 0),
    ]
    return join_frames(frames(requests), rng)


def heartbeats(rng):
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    return join_frames(frames([heartbeat] * 256, range(1, 256)), rng)


CONTENTS = (noise, false_frames, parameter_lists, mixed_requests, commands, heartbeats)


class Udp:
    def __init__(self, port):
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(SOURCES)]
        for one in self._sockets:
            one.setblocking(False)
            one.connect(("127.0.0.1", int(port)))
        self._next = 0

    def write(self, data):
        self._next = (self._next + 1) % SOURCES
        return self._sockets[self._next].send(data)

    def drain(self):
        for one in self._sockets:
            discard_input(lambda one=one: one.recv(65536))


class Tcp:
    def __init__(self, port):
        self._port = int(port)
        self._connect()

    def _connect(self):
        self._socket = socket.create_connection(("127.0.0.1", self._port))
        self._socket.setblocking(False)

    def write(self, data):
        try:
            return self._socket.send(data)
        except (ConnectionResetError, BrokenPipeError):  # dropped after ten seconds without a frame
            self._socket.close()
            self._connect()
            return 0

    def drain(self):
        discard_input(lambda: self._socket.recv(65536))


class Pty:
    def __init__(self, descriptor):
        self._fd = int(descriptor)  # inherited: the near end of a pty has no path
        os.set_blocking(self._fd, False)

    def write(self, data):
        return os.write(self._fd, data)

    def drain(self):
        discard_input(lambda: os.read(self._fd, 65536))


def discard_input(read):
    """Read and discard the available bytes, in at most 50 reads."""
    for _ in range(50):
        try:
            if not read():
                return
        except OSError:
            return


def flood(line, seconds):
    """Write to a line for a time; return the number of accepted bytes."""
    rng = random.Random(SEED)
    pieces = [make(rng) for make in CONTENTS]
    accepted_bytes = 0
    start_s = time.monotonic()
    while (elapsed_s := time.monotonic() - start_s) < seconds:
        kind = pieces[int(elapsed_s / CONTENT_S) % len(pieces)]
        for _ in range(int(BYTES_PER_S * STEP_S / PIECE_BYTES) + 1):
            try:
                accepted_bytes += line.write(rng.choice(kind))
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.ECONNREFUSED, errno.ENOBUFS):
                    raise
                break
        line.drain()
        select.select([], [], [], max(0.0, elapsed_s + STEP_S - (time.monotonic() - start_s)))
    return accepted_bytes


def flood_disk(directory, seconds):
    """Write and sync without a pause, and delete the file; return the number of written bytes."""
    accepted_bytes = 0
    with tempfile.TemporaryFile(dir=directory, buffering=0) as file:
        start_s = time.monotonic()
        while time.monotonic() - start_s < seconds:
            for _ in range(DISK_PIECES):
                accepted_bytes += file.write(DISK_PIECE)
                os.fsync(file.fileno())
                if time.monotonic() - start_s >= seconds:
                    break
            file.seek(0)
    return accepted_bytes


if __name__ == "__main__":
    kind, target, seconds = sys.argv[1:]
    if kind == "disk":
        print(json.dumps(flood_disk(target, float(seconds))))
        sys.exit()
    print(json.dumps(flood({"udp": Udp, "tcp": Tcp, "pty": Pty}[kind](target), float(seconds))))
