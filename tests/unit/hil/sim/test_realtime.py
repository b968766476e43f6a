"""The real-time server with a simulated wall clock."""

import math
import os

import pytest

from hil.devices.pty_line import PtyLine
from hil.devices.serial_line import SerialLine
from hil.errors import HilError
from hil.ship import scenarios
from hil.sim import realtime
from hil.sim.board import Board
from hil.sim.realtime import RealTimeServer
from hil.sim.world import World


class Wall:
    """Time advances only while the server waits, by slightly more than requested."""

    def __init__(self):
        self.now_s = 50.0

    def monotonic(self):
        return self.now_s

    def select(self, _read, _write, _exceptional, timeout_s):
        self.now_s += timeout_s + 0.001
        return [], [], []


class Ticker:
    def __init__(self):
        self.due_s = 0.1
        self.taken = []

    def receive(self, now_s, data):
        self.received = (now_s, data)

    def next_output_s(self):
        return self.due_s

    def take_output(self, now_s):
        self.taken.append(now_s)
        self.due_s = round(self.due_s + 0.1, 6)
        return b"tick;"


@pytest.fixture
def wall(monkeypatch):
    wall = Wall()
    monkeypatch.setattr(realtime, "time", wall)
    monkeypatch.setattr(realtime, "select", wall)
    return wall


def test_events_of_a_late_server_keep_their_times(wall, tmp_path):
    ticker = Ticker()
    with Board(World(scenarios.find_scenario("calm"), 1), {"a": ticker}, tmp_path, PtyLine.write) as board:
        server = RealTimeServer(board)
        wall.now_s += 0.35  # the process was suspended
        slack_s = server.serve(10.0)
        assert ticker.taken == [0.1, 0.2, 0.3, 0.4]
        assert board.world.now_s == pytest.approx(0.401)
        assert slack_s == 0.0  # there was traffic
        assert server.serve(0.45) == pytest.approx(0.05, abs=0.002)
        assert board.world.now_s == 0.45


def test_bytes_reach_the_device(tmp_path):
    ticker = Ticker()
    ticker.due_s = math.inf
    with Board(World(scenarios.find_scenario("calm"), 1), {"a": ticker}, tmp_path, PtyLine.write) as board:
        server = RealTimeServer(board)
        port = os.open(board.paths()["a"], os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(port, b"hello")
            server.serve(5.0)
        finally:
            os.close(port)
        assert ticker.received[1] == b"hello"
        assert 0.0 < ticker.received[0] <= board.world.now_s


def test_an_unplugged_adapter_is_an_error_once(tmp_path):
    float_end, bench_end = os.openpty()
    line = SerialLine(os.ttyname(bench_end), 9600)
    os.close(bench_end)
    with Board(
        World(scenarios.find_scenario("calm"), 1), {"a": Ticker(), "b": Ticker()}, tmp_path, wired={"a": line}
    ) as board:
        server = RealTimeServer(board)
        os.close(float_end)
        line.write(b"tick;")
        assert not line.is_plugged
        with pytest.raises(HilError, match="the line of a is gone"):
            server.serve(0.01)
        server.serve(0.02)
