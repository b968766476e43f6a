"""A hostile correspondent: pours seeded bytes into a link, at a given rate, in one way after another.

`python flood.py udp|tcp PORT SECONDS` or `python flood.py pty DESCRIPTOR SECONDS`; prints, as JSON,
how many bytes the link took. `python flood.py disk DIRECTORY SECONDS` writes there and waits for the
disk, over and over, and prints how many bytes it took.
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
TURN_S = 2.0  # one way of flooding, before the next
SOURCES = 20  # ports to flood from over UDP: more than the boat has room for
SEED = 4
DISK_PIECE, DISK_PIECES = b"\xa5" * (4 << 20), 16  # the file is written over again from its beginning


def frames(messages, systems=(255,)):
    """A piece full of messages, from each of the systems in turn."""
    packed = []
    for number, message in enumerate(messages):
        station = mavlink.MAVLink(None, srcSystem=systems[number % len(systems)], srcComponent=190)
        station.seq = number % 256
        packed.append(message.pack(station))
    return packed


def filled(packed, chances):
    """Pieces of whole frames, in seeded order."""
    pieces = []
    for _ in range(32):
        piece = b""
        while len(piece) < PIECE_BYTES - 280:
            piece += chances.choice(packed)
        pieces.append(piece)
    return pieces


def noise(chances):
    return [chances.randbytes(PIECE_BYTES) for _ in range(64)]


def false_frames(chances):
    """Beginnings of the longest frames, as dense as they can be: a checksum over 260 bytes at each fifth byte."""
    crafted = b"\xfd\xff\x00\x00\x00" * (PIECE_BYTES // 5)
    markers = [bytes(chances.choice((0xFD, 0xFE, 0, 1)) for _ in range(PIECE_BYTES)) for _ in range(16)]
    return [crafted, *markers]


def lists(chances):
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
    return filled(frames(requests), chances)


def one_list(chances):
    return filled(frames([mavlink.MAVLink_param_request_list_message(1, 1)] * 4), chances)


def commands(chances):
    numbers = (176, 400, 410, 511, 512, 519, 520, 401, 115, 21196, 31010)
    requests = [
        mavlink.MAVLink_command_long_message(1, 1, number, chances.randrange(2), *values)
        for number in numbers
        for values in ([0.0] * 7, [chances.uniform(-1e3, 1e3) for _ in range(7)], [435.0, 0, 0, 0, 0, 0, 0])
    ]
    requests += [
        mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", chances.uniform(0, 300), 9),
        mavlink.MAVLink_mission_count_message(1, 1, 60000, 0),
    ]
    return filled(frames(requests), chances)


def heartbeats(chances):
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    return filled(frames([beat] * 256, range(1, 256)), chances)


WAYS = (noise, false_frames, one_list, lists, commands, heartbeats)


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
            swallow(lambda one=one: one.recv(65536))


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
        swallow(lambda: self._socket.recv(65536))


class Pty:
    def __init__(self, descriptor):
        self._fd = int(descriptor)  # inherited: the near end of a terminal has no path to be opened by
        os.set_blocking(self._fd, False)

    def write(self, data):
        return os.write(self._fd, data)

    def drain(self):
        swallow(lambda: os.read(self._fd, 65536))


def swallow(read):
    """Read what there is, up to a bound."""
    for _ in range(50):
        try:
            if not read():
                return
        except OSError:
            return


def flood(way, seconds):
    chances = random.Random(SEED)
    pieces = [make(chances) for make in WAYS]
    taken = 0
    start_s = time.monotonic()
    while (elapsed_s := time.monotonic() - start_s) < seconds:
        kind = pieces[int(elapsed_s / TURN_S) % len(pieces)]
        for _ in range(int(BYTES_PER_S * STEP_S / PIECE_BYTES) + 1):
            try:
                taken += way.write(chances.choice(kind))
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.ECONNREFUSED, errno.ENOBUFS):
                    raise
                break
        way.drain()
        select.select([], [], [], max(0.0, elapsed_s + STEP_S - (time.monotonic() - start_s)))
    return taken


def flood_disk(directory, seconds):
    """Write and sync without a pause; the file is gone in the end."""
    taken = 0
    with tempfile.TemporaryFile(dir=directory, buffering=0) as file:
        start_s = time.monotonic()
        while time.monotonic() - start_s < seconds:
            for _ in range(DISK_PIECES):
                taken += file.write(DISK_PIECE)
                os.fsync(file.fileno())
                if time.monotonic() - start_s >= seconds:
                    break
            file.seek(0)
    return taken


if __name__ == "__main__":
    kind, where, seconds = sys.argv[1:]
    if kind == "disk":
        print(json.dumps(flood_disk(where, float(seconds))))
        sys.exit()
    print(json.dumps(flood({"udp": Udp, "tcp": Tcp, "pty": Pty}[kind](where), float(seconds))))
