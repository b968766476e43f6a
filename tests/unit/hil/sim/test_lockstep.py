"""The lockstep server against a tiny autopilot in a thread."""

import json
import math
import os
import socket
import struct
import threading

import pytest

from hil.devices.pty_line import PtyLine
from hil.ship import scenarios
from hil.sim.board import Board
from hil.sim.lockstep import LockstepError, LockstepServer
from hil.sim.pace import Pacer
from hil.sim.world import World


class Beacon:
    """Says its time every `period_s`; answers what it hears after an eighth of a second."""

    def __init__(self, period_s=math.inf):
        self.period_s = period_s
        self.due_s = period_s
        self.answers = []
        self.heard = []

    def receive(self, now_s, data):
        self.heard.append((now_s, data))
        self.answers.append((now_s + 0.125, data.upper()))

    def next_output_s(self):
        return min([self.due_s, *(due_s for due_s, _ in self.answers)])

    def take_output(self, now_s):
        said = b""
        if self.due_s <= now_s:
            said += b"%.4f;" % self.due_s
            self.due_s += self.period_s
        said += b"".join(data for due_s, data in self.answers if due_s <= now_s)
        self.answers = [answer for answer in self.answers if answer[0] > now_s]
        return said


class Autopilot(threading.Thread):
    """Runs a script of waits: (deadline, {line: bytes to write before}); notes times and bytes read."""

    def __init__(self, path, ports, script, *, protocol=1):
        super().__init__()
        self.path, self.ports, self.script, self.protocol = path, ports, script, protocol
        self.seen = []
        self.welcome = None

    def run(self):
        files = [os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for port in self.ports]
        written = [0] * len(files)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link:
            link.connect(str(self.path))
            link.sendall(json.dumps({"protocol": self.protocol, "lines": self.ports}).encode())
            self.welcome = link.recv(1000)
            for deadline_s, writes in self.script if self.welcome else ():
                for index, data in writes.items():
                    written[index] += os.write(files[index], data)
                link.sendall(struct.pack(f"<d{len(files)}Q", deadline_s, *written))
                if not (answer := link.recv(100)):
                    break
                self.seen.append((struct.unpack("<d", answer)[0], [read_now(file) for file in files]))
        for file in files:
            os.close(file)


def read_now(file):
    try:
        return os.read(file, 4096)
    except BlockingIOError:
        return b""


def make_board(tmp_path, **emulators):
    return Board(World(scenarios.named("calm"), 1), emulators, tmp_path, PtyLine.deliver)


def serve_all(server, autopilot):
    autopilot.start()
    try:
        server.accept(lambda: True, 1000.0)
        while server.serve():
            pass
    finally:
        server.close()
        autopilot.join(10.0)


def test_time_moves_to_the_deadline_or_to_the_first_bytes_and_no_further(tmp_path):
    with make_board(tmp_path, a=Beacon(0.25), b=Beacon()) as board:
        ports = board.paths()
        script = [(0.125, {}), (1.0, {0: b"ping"}), (0.375, {}), (1.0, {})]
        autopilot = Autopilot(tmp_path / "clock", [ports["b"], ports["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert json.loads(autopilot.welcome) == {"start_s": 0.0, "utc_s": 1000.0}
        assert autopilot.seen == [
            (0.125, [b"", b""]),
            (0.25, [b"PING", b"0.2500;"]),
            (0.375, [b"", b""]),
            (0.5, [b"", b"0.5000;"]),
        ]
        assert board.world.now_s == 0.5


def test_bytes_written_reach_the_device_at_the_time_they_were_written(tmp_path):
    beacon = Beacon()
    with make_board(tmp_path, a=beacon) as board:
        script = [(0.1, {}), (0.5, {0: b"one"}), (0.5, {}), (0.5, {0: b"two"}), (0.5, {})]
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert beacon.heard == [(0.1, b"one"), (0.5, b"two")]
        assert [data for _, (data,) in autopilot.seen] == [b"", b"ONE", b"", b"", b""]


def test_the_world_stops_at_the_limit(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [(5.0, {})])
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot.start()
            server.accept(lambda: True, 0.0)
            assert server.serve(2.0)
        autopilot.join(10.0)
        assert autopilot.seen == [(2.0, [b""])]


def test_a_line_that_is_not_ours_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        strange = os.ttyname(board.ports[0].line._slave)  # the line by another name
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot = Autopilot(tmp_path / "clock", [strange], [])
            autopilot.start()
            with pytest.raises(LockstepError, match="no line of this board"):
                server.accept(lambda: True, 0.0)
        autopilot.join(10.0)


def test_another_protocol_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [], protocol=2)
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot.start()
            with pytest.raises(LockstepError, match="protocol 2"):
                server.accept(lambda: True, 0.0)
        autopilot.join(10.0)


@pytest.mark.parametrize("hello", [b"{}", b"\xff\xfe", b"[]", b'{"protocol": 1, "lines": 5}'])
def test_a_greeting_that_is_none_is_an_error(tmp_path, hello):
    with (
        make_board(tmp_path, a=Beacon()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
    ):
        link.connect(str(tmp_path / "clock"))
        link.sendall(hello)
        with pytest.raises(LockstepError, match="greets"):
            server.accept(lambda: True, 0.0)


@pytest.mark.parametrize(("packet", "text"), [(b"12345", "5 bytes"), (struct.pack("<dQ", math.nan, 0), "not a number")])
def test_a_packet_that_is_none_is_an_error(tmp_path, packet, text):
    with (
        make_board(tmp_path, a=Beacon()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
    ):
        link.connect(str(tmp_path / "clock"))
        link.sendall(json.dumps({"protocol": 1, "lines": [board.paths()["a"]]}).encode())
        server.accept(lambda: True, 0.0)
        link.sendall(packet)
        with pytest.raises(LockstepError, match=text):
            server.serve()


def test_an_autopilot_that_hangs_or_dies_is_told(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        with (
            LockstepServer(tmp_path / "one", board, Pacer(math.inf)) as server,
            pytest.raises(LockstepError, match="ended before"),
        ):
            server.accept(lambda: False, 0.0)
        with (
            LockstepServer(tmp_path / "two", board, Pacer(math.inf), stall_s=0.05) as server,
            socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
        ):
            link.connect(str(tmp_path / "two"))
            link.sendall(json.dumps({"protocol": 1, "lines": []}).encode())
            server.accept(lambda: True, 0.0)
            with pytest.raises(LockstepError, match="hangs"):
                server.serve()
            link.close()
            assert not server.serve()


def test_a_path_that_cannot_be_listened_at_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board, pytest.raises(LockstepError, match="lockstep socket"):
        LockstepServer(tmp_path / "absent" / "clock", board, Pacer(math.inf))
