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
    """Sends its time every `period_s`; replies to bytes after an eighth of a second."""

    def __init__(self, period_s=math.inf):
        self.period_s = period_s
        self.due_s = period_s
        self.answers = []
        self.received = []

    def receive(self, now_s, data):
        self.received.append((now_s, data))
        self.answers.append((now_s + 0.125, data.upper()))

    def next_output_s(self):
        return min([self.due_s, *(due_s for due_s, _ in self.answers)])

    def take_output(self, now_s):
        output = b""
        if self.due_s <= now_s:
            output += b"%.4f;" % self.due_s
            self.due_s += self.period_s
        output += b"".join(data for due_s, data in self.answers if due_s <= now_s)
        self.answers = [answer for answer in self.answers if answer[0] > now_s]
        return output


class Autopilot(threading.Thread):
    """Runs a script of waits: (deadline, {line: bytes to write before}, awaited lines, lines to read).

    Without lists all lines are awaited, and awaited lines are read. Records the time after each wait, the bytes that it
    has read, and the earlier outputs that the reply reports, if any.
    """

    def __init__(self, path, ports, script, *, protocol=2):
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
            for deadline_s, writes, *lines in self.script if self.welcome else ():
                for index, data in writes.items():
                    written[index] += os.write(files[index], data)
                awaited = lines[0] if lines else range(len(files))
                read_lines = lines[-1] if lines else awaited
                link.sendall(struct.pack(f"<dQ{len(files)}Q", deadline_s, sum(1 << line for line in awaited), *written))
                if not (reply := link.recv(100)):
                    break
                read = [read_now(file) if line in read_lines else b"" for line, file in enumerate(files)]
                outputs = [*struct.iter_unpack("<dQ", reply[24:])]
                self.seen.append((struct.unpack_from("<d", reply)[0], read, *([outputs] if outputs else [])))
        for file in files:
            os.close(file)


def read_now(file):
    try:
        return os.read(file, 4096)
    except BlockingIOError:
        return b""


def make_board(tmp_path, **emulators):
    return Board(World(scenarios.find_scenario("calm"), 1), emulators, tmp_path, PtyLine.deliver)


def serve_all(server, autopilot):
    autopilot.start()
    try:
        server.accept(lambda: True, 1000.0)
        while server.serve():
            pass
    finally:
        server.close()
        autopilot.join(10.0)


def test_time_advances_to_the_deadline_or_to_the_first_bytes(tmp_path):
    with make_board(tmp_path, a=Beacon(0.25), b=Beacon()) as board:
        ports = board.paths()
        script = [(0.125, {}), (1.0, {0: b"ping"}), (0.375, {}), (1.0, {})]
        autopilot = Autopilot(tmp_path / "clock", [ports["b"], ports["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert json.loads(autopilot.welcome) == {"start_s": 0.0, "utc_s": 1000.0}
        assert autopilot.seen == [
            (0.125, [b"", b""]),
            (0.25, [b"PING", b"0.2500;"], [(0.25, 1)]),
            (0.375, [b"", b""]),
            (0.5, [b"", b"0.5000;"], [(0.5, 1)]),
        ]
        assert board.world.now_s == 0.5


def test_bytes_on_a_line_that_is_not_awaited_end_a_later_wait_for_it(tmp_path):
    with make_board(tmp_path, a=Beacon(), b=Beacon()) as board:
        ports = board.paths()
        script = [(0.1, {0: b"one"}, []), (0.3, {}, [1]), (0.9, {}, [0, 1]), (0.9, {1: b"two"}, [0]), (1.0, {}, [1])]
        autopilot = Autopilot(tmp_path / "clock", [ports["a"], ports["b"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert autopilot.seen == [
            (0.1, [b"", b""]),
            (0.3, [b"", b""]),
            (0.3, [b"ONE", b""]),  # there since 0.125
            (0.9, [b"", b""]),
            (0.9, [b"", b"TWO"]),
        ]


def test_bytes_left_unread_end_the_next_wait(tmp_path):
    """Like bytes of a link just before a tick, when the loop does not read it."""
    with make_board(tmp_path, a=Beacon()) as board:
        script = [(0.1, {0: b"one"}), (0.3, {}, [0], []), (0.9, {}, [], []), (1.0, {}, [0], []), (1.0, {})]
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert autopilot.seen == [(0.1, [b""]), (0.125, [b""]), (0.9, [b""]), (0.9, [b""]), (0.9, [b"ONE"])]


def test_bytes_read_in_the_meantime_end_no_wait(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        script = [(0.1, {0: b"one"}), (0.3, {}, [], [0]), (0.9, {})]
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert autopilot.seen == [(0.1, [b""]), (0.3, [b"ONE"]), (0.9, [b""])]


def test_outputs_on_a_line_without_requests_are_reported_with_their_times(tmp_path):
    with make_board(tmp_path, a=Beacon(0.25), b=Beacon(0.375)) as board:
        ports = board.paths()
        script = [(0.3, {}), (0.9, {}), (0.9, {0: b"x"}), (0.9, {}), (0.9, {})]
        autopilot = Autopilot(tmp_path / "clock", [ports["a"], ports["b"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert autopilot.seen == [
            (0.3, [b"0.2500;", b""], [(0.25, 0)]),
            (0.5, [b"0.5000;", b"0.3750;"], [(0.375, 1), (0.5, 0)]),  # the next of the first would be read with this
            (0.625, [b"X", b""]),
            (0.75, [b"0.7500;", b"0.7500;"], [(0.75, 1)]),
            (0.9, [b"", b""]),
        ]


def test_bytes_reach_the_device_at_the_time_of_writing(tmp_path):
    beacon = Beacon()
    with make_board(tmp_path, a=beacon) as board:
        script = [(0.1, {}), (0.5, {0: b"one"}), (0.5, {}), (0.5, {0: b"two"}), (0.5, {})]
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], script)
        serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)
        assert beacon.received == [(0.1, b"one"), (0.5, b"two")]
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


def test_an_unknown_line_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        strange = os.ttyname(board.ports[0].line._slave)  # the line by another name
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot = Autopilot(tmp_path / "clock", [strange], [])
            autopilot.start()
            with pytest.raises(LockstepError, match="not a line of this board"):
                server.accept(lambda: True, 0.0)
        autopilot.join(10.0)


def test_another_protocol_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [], protocol=3)
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot.start()
            with pytest.raises(LockstepError, match="protocol 3"):
                server.accept(lambda: True, 0.0)
        autopilot.join(10.0)


@pytest.mark.parametrize("hello", [b"{}", b"\xff\xfe", b"[]", b'{"protocol": 2, "lines": 5}'])
def test_an_invalid_first_packet_is_an_error(tmp_path, hello):
    with (
        make_board(tmp_path, a=Beacon()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
    ):
        link.connect(str(tmp_path / "clock"))
        link.sendall(hello)
        with pytest.raises(LockstepError, match="first packet"):
            server.accept(lambda: True, 0.0)


@pytest.mark.parametrize(
    ("packet", "text"), [(b"12345", "5 bytes"), (struct.pack("<dQQ", math.nan, 0, 0), "not a number")]
)
def test_an_invalid_packet_is_an_error(tmp_path, packet, text):
    with (
        make_board(tmp_path, a=Beacon()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
    ):
        link.connect(str(tmp_path / "clock"))
        link.sendall(json.dumps({"protocol": 2, "lines": [board.paths()["a"]]}).encode())
        server.accept(lambda: True, 0.0)
        link.sendall(packet)
        with pytest.raises(LockstepError, match=text):
            server.serve()


def test_an_autopilot_that_hangs_or_ends_is_an_error(tmp_path):
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
            link.sendall(json.dumps({"protocol": 2, "lines": []}).encode())
            server.accept(lambda: True, 0.0)
            with pytest.raises(LockstepError, match="hangs"):
                server.serve()
            link.close()
            assert not server.serve()


def test_bytes_that_do_not_arrive_are_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(PtyLine, "wait_for_posted", lambda _line: False)
    with make_board(tmp_path, a=Beacon()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [(1.0, {})])
        with pytest.raises(LockstepError, match="have not arrived at a"):
            serve_all(LockstepServer(tmp_path / "clock", board, Pacer(math.inf)), autopilot)


def test_an_unusable_socket_path_is_an_error(tmp_path):
    with make_board(tmp_path, a=Beacon()) as board, pytest.raises(LockstepError, match="lockstep socket"):
        LockstepServer(tmp_path / "absent" / "clock", board, Pacer(math.inf))
