"""The lockstep server with a scripted autopilot in a thread."""

import json
import math
import os
import socket
import struct
import threading
from contextlib import contextmanager

import pytest

from hil.devices.pty_line import PtyLine
from hil.ship import scenarios
from hil.sim.board import Board
from hil.sim.lockstep import LockstepError, LockstepServer
from hil.sim.pace import Pacer
from hil.sim.world import World


class Device:
    """An emulator that sends its time each `period_s` and replies to bytes after 0.125 s."""

    def __init__(self, period_s=math.inf):
        self.period_s = period_s
        self.due_s = period_s
        self.replies = []
        self.received = []

    def receive(self, now_s, data):
        self.received.append((now_s, data))
        self.replies.append((now_s + 0.125, data.upper()))

    def next_output_s(self):
        return min([self.due_s, *(due_s for due_s, _ in self.replies)])

    def take_output(self, now_s):
        output = b""
        if self.due_s <= now_s:
            output += b"%.4f;" % self.due_s
            self.due_s += self.period_s
        output += b"".join(data for due_s, data in self.replies if due_s <= now_s)
        self.replies = [reply for reply in self.replies if reply[0] > now_s]
        return output


class Autopilot(threading.Thread):
    """Runs a script of waits: (deadline, {line: bytes to write before}, awaited lines, lines to read).

    Without lists all lines are awaited, and awaited lines are read. Records the time after each wait, the bytes read,
    and the earlier outputs in the reply, if any.
    """

    def __init__(self, path, ports, script, *, protocol=2):
        super().__init__()
        self.path, self.ports, self.script, self.protocol = path, ports, script, protocol
        self.records = []
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
                self.records.append((struct.unpack_from("<d", reply)[0], read, *([outputs] if outputs else [])))
        for file in files:
            os.close(file)


def read_now(file):
    try:
        return os.read(file, 4096)
    except BlockingIOError:
        return b""


def make_board(tmp_path, **emulators):
    return Board(World(scenarios.find_scenario("calm"), 1), emulators, tmp_path, PtyLine.deliver)


def serve_all(board, autopilot):
    server = LockstepServer(autopilot.path, board, Pacer(math.inf))
    autopilot.start()
    try:
        server.accept(lambda: True, 1000.0)
        while server.serve():
            pass
    finally:
        server.close()
        autopilot.join(10.0)


def test_time_advances_to_the_deadline_or_to_the_first_bytes(tmp_path):
    with make_board(tmp_path, a=Device(0.25), b=Device()) as board:
        ports = board.paths()
        script = [(0.125, {}), (1.0, {0: b"ping"}), (0.375, {}), (1.0, {})]
        autopilot = Autopilot(tmp_path / "clock", [ports["b"], ports["a"]], script)
        serve_all(board, autopilot)
        assert json.loads(autopilot.welcome) == {"start_s": 0.0, "utc_s": 1000.0}
        assert autopilot.records == [
            (0.125, [b"", b""]),
            (0.25, [b"PING", b"0.2500;"], [(0.25, 1)]),
            (0.375, [b"", b""]),
            (0.5, [b"", b"0.5000;"], [(0.5, 1)]),
        ]
        assert board.world.now_s == 0.5


NEVER = math.inf
# Periods of the devices a and b, script, records.
WAITS = {
    "bytes on a line that is not awaited end a later wait for it": (
        (NEVER, NEVER),
        [(0.1, {0: b"one"}, []), (0.3, {}, [1]), (0.9, {}, [0, 1]), (0.9, {1: b"two"}, [0]), (1.0, {}, [1])],
        [(0.1, [b"", b""]), (0.3, [b"", b""]), (0.3, [b"ONE", b""]), (0.9, [b"", b""]), (0.9, [b"", b"TWO"])],
    ),
    "unread bytes end the next wait": (
        (NEVER,),
        [(0.1, {0: b"one"}), (0.3, {}, [0], []), (0.9, {}, [], []), (1.0, {}, [0], []), (1.0, {})],
        [(0.1, [b""]), (0.125, [b""]), (0.9, [b""]), (0.9, [b""]), (0.9, [b"ONE"])],
    ),
    "bytes that were read do not end a wait": (
        (NEVER,),
        [(0.1, {0: b"one"}), (0.3, {}, [], [0]), (0.9, {})],
        [(0.1, [b""]), (0.3, [b"ONE"]), (0.9, [b""])],
    ),
    "outputs on a line without requests are reported with their times": (
        (0.25, 0.375),
        [(0.3, {}), (0.9, {}), (0.9, {0: b"x"}), (0.9, {}), (0.9, {})],
        [
            (0.3, [b"0.2500;", b""], [(0.25, 0)]),
            (0.5, [b"0.5000;", b"0.3750;"], [(0.375, 1), (0.5, 0)]),
            (0.625, [b"X", b""]),
            (0.75, [b"0.7500;", b"0.7500;"], [(0.75, 1)]),
            (0.9, [b"", b""]),
        ],
    ),
}


@pytest.mark.parametrize(("periods_s", "script", "records"), WAITS.values(), ids=WAITS)
def test_wait_ends_at_its_deadline_or_with_bytes(tmp_path, periods_s, script, records):
    with make_board(tmp_path, **dict(zip("ab", map(Device, periods_s), strict=False))) as board:
        autopilot = Autopilot(tmp_path / "clock", list(board.paths().values()), script)
        serve_all(board, autopilot)
        assert autopilot.records == records


def test_bytes_reach_the_device_at_the_time_of_writing(tmp_path):
    device = Device()
    with make_board(tmp_path, a=device) as board:
        script = [(0.1, {}), (0.5, {0: b"one"}), (0.5, {}), (0.5, {0: b"two"}), (0.5, {})]
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], script)
        serve_all(board, autopilot)
        assert device.received == [(0.1, b"one"), (0.5, b"two")]
        assert [data for _, (data,) in autopilot.records] == [b"", b"ONE", b"", b"", b""]


def test_world_stops_at_the_limit(tmp_path):
    with make_board(tmp_path, a=Device()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [(5.0, {})])
        with LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server:
            autopilot.start()
            server.accept(lambda: True, 0.0)
            assert server.serve(2.0)
        autopilot.join(10.0)
        assert autopilot.records == [(2.0, [b""])]


@contextmanager
def connected(tmp_path, hello, **options):
    """Yield a server and the connection of an autopilot that has sent its first packet; line 0 is of the board."""
    with (
        make_board(tmp_path, a=Device()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf), **options) as server,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link,
    ):
        link.connect(str(tmp_path / "clock"))
        link.sendall(hello if isinstance(hello, bytes) else json.dumps(hello(board)).encode())
        yield server, link


def hello_of(board):
    return {"protocol": 2, "lines": list(board.paths().values())}


@pytest.mark.parametrize(
    ("hello", "error"),
    [
        *[(hello, "first packet") for hello in (b"{}", b"\xff\xfe", b"[]", b'{"protocol": 2, "lines": 5}')],
        (lambda board: {**hello_of(board), "protocol": 3}, "protocol 3"),
        (lambda board: {"protocol": 2, "lines": [os.ttyname(board.ports[0].line._slave)]}, "not a line of this board"),
    ],
)
def test_invalid_first_packet_raises_an_error(tmp_path, hello, error):
    with connected(tmp_path, hello) as (server, _), pytest.raises(LockstepError, match=error):
        server.accept(lambda: True, 0.0)


@pytest.mark.parametrize(
    ("packet", "error"), [(b"12345", "5 bytes"), (struct.pack("<dQQ", math.nan, 0, 0), "not a number")]
)
def test_invalid_packet_raises_an_error(tmp_path, packet, error):
    with connected(tmp_path, hello_of) as (server, link):
        server.accept(lambda: True, 0.0)
        link.sendall(packet)
        with pytest.raises(LockstepError, match=error):
            server.serve()


def test_autopilot_that_ends_before_it_connects_raises_an_error(tmp_path):
    with (
        make_board(tmp_path, a=Device()) as board,
        LockstepServer(tmp_path / "clock", board, Pacer(math.inf)) as server,
        pytest.raises(LockstepError, match="ended before"),
    ):
        server.accept(lambda: False, 0.0)


def test_autopilot_that_hangs_raises_an_error_and_closed_socket_ends_the_run(tmp_path):
    with connected(tmp_path, hello_of, stall_s=0.05) as (server, link):
        server.accept(lambda: True, 0.0)
        with pytest.raises(LockstepError, match="hangs"):
            server.serve()
        link.close()
        assert not server.serve()


def test_bytes_that_do_not_arrive_raise_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(PtyLine, "wait_for_posted", lambda _line: False)
    with make_board(tmp_path, a=Device()) as board:
        autopilot = Autopilot(tmp_path / "clock", [board.paths()["a"]], [(1.0, {})])
        with pytest.raises(LockstepError, match="have not arrived at a"):
            serve_all(board, autopilot)


def test_unusable_socket_path_raises_an_error(tmp_path):
    with make_board(tmp_path, a=Device()) as board, pytest.raises(LockstepError, match="lockstep socket"):
        LockstepServer(tmp_path / "absent" / "clock", board, Pacer(math.inf))
