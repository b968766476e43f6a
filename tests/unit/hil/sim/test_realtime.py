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


class Clock:
    """Time advances only while the server waits, by slightly more than requested."""

    def __init__(self):
        self.now_s = 50.0

    def monotonic(self):
        return self.now_s

    def select(self, _read, _write, _exceptional, timeout_s):
        self.now_s += timeout_s + 0.001
        return [], [], []


class Device:
    """An emulator that sends a message each 0.1 s."""

    def __init__(self):
        self.due_s = 0.1
        self.output_times_s = []

    def receive(self, now_s, data):
        self.received = (now_s, data)

    def next_output_s(self):
        return self.due_s

    def take_output(self, now_s):
        self.output_times_s.append(now_s)
        self.due_s = round(self.due_s + 0.1, 6)
        return b"tick;"


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(realtime, "time", clock)
    monkeypatch.setattr(realtime, "select", clock)
    return clock


def test_events_of_a_late_server_keep_their_times(clock, tmp_path):
    device = Device()
    with Board(World(scenarios.find_scenario("calm"), 1), {"a": device}, tmp_path, PtyLine.write) as board:
        server = RealTimeServer(board)
        clock.now_s += 0.35  # as a suspended process
        slack_s = server.serve(10.0)
        assert device.output_times_s == [0.1, 0.2, 0.3, 0.4]
        assert board.world.now_s == pytest.approx(0.401)
        assert slack_s == 0.0
        assert server.serve(0.45) == pytest.approx(0.05, abs=0.002)
        assert board.world.now_s == 0.45


def test_bytes_are_passed_to_the_device(tmp_path):
    device = Device()
    device.due_s = math.inf
    with Board(World(scenarios.find_scenario("calm"), 1), {"a": device}, tmp_path, PtyLine.write) as board:
        server = RealTimeServer(board)
        port = os.open(board.paths()["a"], os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(port, b"hello")
            server.serve(5.0)
        finally:
            os.close(port)
        assert device.received[1] == b"hello"
        assert 0.0 < device.received[0] <= board.world.now_s


def test_unplugged_adapter_raises_an_error_once(tmp_path):
    float_end, bench_end = os.openpty()
    line = SerialLine(os.ttyname(bench_end), 9600)
    os.close(bench_end)
    with Board(
        World(scenarios.find_scenario("calm"), 1), {"a": Device(), "b": Device()}, tmp_path, wired={"a": line}
    ) as board:
        server = RealTimeServer(board)
        os.close(float_end)
        line.write(b"tick;")
        assert not line.is_plugged
        with pytest.raises(HilError, match="the line of a is gone"):
            server.serve(0.01)
        server.serve(0.02)
