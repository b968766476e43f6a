"""Cables pulled and power cut while the real autopilot runs in real time; nothing is restarted."""

import functools
import math
import operator
import select
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_py.__main__ import main
from firmware_py.log.reader import read_log
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.impairment import Impaired
from hil.devices.mti import MtiEmulator
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.volz import VolzEmulator
from hil.ship.scenarios import named
from hil.sim.board import Board
from hil.sim.process import AutopilotProcess
from hil.sim.world import World

VEHICLE = """
[compass]
driver = "{compass}"
port = "{ports[compass]}"
baud = 38400
[rudder]
driver = "{rudder}"
port = "{ports[rudder]}"
baud = {baud}
[parameters]
BOOT_ARM = 1
BOOT_MODE = 15
CTL_HOLD_S = 1
EST_MODE = 0
CTL_MODE = 0
"""
SERVOS = {"dynamixel": (DynamixelEmulator, 57600), "volz": (VolzEmulator, 115200)}
COMPASSES = {"nmea": NmeaCompassEmulator, "pni_tcm": PniTcmEmulator, "mti": MtiEmulator}


class Bench:
    """The autopilot on emulated devices; the test decides how long things go on and what breaks."""

    def __init__(self, directory, compass, servo, wait=False):
        self.directory = directory
        self.world = World(named("calm"), 1)
        make, baud = SERVOS[servo]
        rng = np.random.default_rng
        self.servo = make(self.world.shaft, rng(1), baud=baud)
        self.compass_device = COMPASSES[compass](self.world, rng(2))
        self.compass = Impaired(self.compass_device, rng(3))
        self.board = Board(self.world, {"compass": self.compass, "rudder": self.servo}, directory, PtyLine.write)
        self.lines = {port.path.name: port.line for port in self.board.ports}
        vehicle = directory / "boat.toml"
        vehicle.write_text(VEHICLE.format(compass=compass, rudder=servo, ports=self.board.paths(), baud=baud))
        arguments = ["run", str(vehicle), "--state", str(directory / "state"), *(["--wait"] if wait else [])]
        self._arguments = arguments
        self.firmware = None
        self.start_s = 0.0

    def __enter__(self):
        return self

    def start(self):
        self.firmware = AutopilotProcess(self._arguments, self.directory / "firmware.log")
        self.start_s = time.monotonic() - self.world.now_s
        return self

    def __exit__(self, *error):
        if self.firmware is not None:
            self.firmware.terminate()
            self.run(0.5)
            self.firmware.__exit__(*error)
        self.board.close()

    def replays(self):
        """Whether the log of the run, faults and all, is recomputed to the same bits."""
        self.firmware.terminate()
        self.run(2.5)
        logs = sorted((self.directory / "state" / "logs").glob("*.BIN"))
        return bool(logs) and all(main(["replay", str(log)]) == 0 for log in logs)

    def run(self, seconds):
        """Let the world go on in real time."""
        end_s = self.world.now_s + seconds
        while (now_s := time.monotonic() - self.start_s) < end_s:
            while self.board.advance(now_s):
                pass
            plugged = {line.fileno(): name for name, line in self.lines.items() if line.plugged}
            wait_s = min(self.board.next_output_s(), end_s) - (time.monotonic() - self.start_s)
            for fd in select.select(list(plugged), [], [], max(0.0, min(wait_s, 0.02)))[0]:
                station = self.board.port_at(str(self.directory / plugged[fd]))
                self.board.receive(station, station.line.read())

    def until(self, text, seconds=15.0):
        """Run until the autopilot has said text once more than before."""
        before = self.words().count(text)
        end_s = self.world.now_s + seconds
        while self.words().count(text) == before:
            assert self.world.now_s < end_s, f"{text!r} not said within {seconds} s:\n{self.words()}"
            assert self.firmware.running(), self.words()
            self.run(0.1)

    def words(self):
        return (self.directory / "firmware.log").read_text()

    def turn_by_hand(self):
        """Put her 30 degrees off her goal, so that the rudder has to work."""
        self.world._hull._plant.heading_rad += math.radians(30.0)


@pytest.fixture(params=[("nmea", "dynamixel"), ("pni_tcm", "volz")], ids="-".join)
def bench(tmp_path, request):
    with Bench(tmp_path, *request.param) as made:
        made.start()
        made.until("Mode GUIDED")
        made.run(1.5)
        yield made
        assert made.replays()


def steers(bench):
    """Whether the rudder still answers to the heading."""
    bench.turn_by_hand()
    before_rad = bench.world.shaft.angle_rad()
    bench.run(1.5)
    return abs(bench.world.shaft.angle_rad() - before_rad) > math.radians(5.0)


def test_the_servo_s_cable_out_and_in(bench):
    bench.lines["rudder"].unplug()
    bench.until("Rudder servo does not answer")
    bench.lines["rudder"].plug()
    bench.until("Rudder servo answers again")
    bench.run(1.0)
    assert steers(bench)
    assert bench.firmware.running()


def test_the_compass_s_cable_out_and_in(bench):
    bench.lines["compass"].unplug()
    bench.until("No heading: rudder held, then amidships")
    bench.run(2.5)
    assert abs(bench.world.shaft.angle_rad()) < math.radians(1.0)
    bench.lines["compass"].plug()
    bench.until("Heading is back")
    assert steers(bench)


def test_the_servo_s_power_cut_and_back(bench):
    bench.servo.power_cycle(bench.world.now_s, off_s=2.0)
    bench.until("Rudder servo does not answer")
    bench.until("Rudder servo answers again")
    bench.run(1.5)
    assert steers(bench)


@pytest.mark.parametrize("compass", ["pni_tcm", "mti"])
def test_the_compass_s_power_cut_and_back(tmp_path, compass):
    with Bench(tmp_path, compass, "dynamixel") as bench:
        bench.start().until("Mode GUIDED")
        bench.run(1.5)
        bench.compass_device.power_cycle(bench.world.now_s, off_s=1.5)
        bench.until("No heading: rudder held, then amidships")
        bench.until("Heading is back")
        assert steers(bench)


def test_a_noisy_line_costs_samples_and_nothing_else(bench):
    bench.compass.flip = 0.002
    bench.compass.garbage = 0.2
    bench.run(6.0)
    bench.compass.flip = bench.compass.garbage = 0.0
    assert bench.firmware.running()
    assert steers(bench)
    bench.firmware.terminate()
    bench.run(1.0)
    headings_deg = [
        math.degrees(sample.heading_rad)
        for path in sorted(Path(bench.directory / "state" / "logs").glob("*.BIN"))
        for tick in read_log(path)
        for sample in tick.inputs.headings
    ]
    assert len(headings_deg) > 30
    assert all(heading_deg < 40.0 or heading_deg > 350.0 for heading_deg in headings_deg)


@pytest.mark.parametrize("field", ["400.0", "-10.0", "1e300", "nan", "", "999999999999"])
def test_a_compass_that_says_the_impossible_is_not_believed(tmp_path, field):
    body = f"HEHDT,{field},T".encode()
    sentence = b"$%s*%02X\r\n" % (body, functools.reduce(operator.xor, body))
    with Bench(tmp_path, "nmea", "volz") as bench:
        bench.start().until("Mode GUIDED")
        bench.run(1.0)
        for _ in range(20):
            bench.lines["compass"].write(sentence)
            bench.run(0.1)
        assert abs(bench.world.shaft.angle_rad()) < math.radians(3.0)
        assert "heading" not in bench.words()
        assert bench.replays()
    (path,) = (tmp_path / "state" / "logs").glob("*.BIN")
    headings_rad = [sample.heading_rad for tick in read_log(path) for sample in tick.inputs.headings]
    assert len(headings_rad) > 10
    assert all(min(heading_rad, 2 * math.pi - heading_rad) < 0.1 for heading_rad in headings_rad)


def test_ports_that_come_later_are_taken_up_with_wait(tmp_path):
    with Bench(tmp_path, "nmea", "volz", wait=True) as bench:
        for line in bench.lines.values():
            line.unplug()
        bench.start().run(1.5)
        assert bench.firmware.running()
        for line in bench.lines.values():
            line.plug()
        bench.until("Rudder servo answers again")
        bench.run(1.5)
        assert steers(bench)


def test_the_end_brings_the_rudder_amidships(bench):
    bench.turn_by_hand()
    bench.run(2.0)
    assert abs(bench.world.shaft.angle_rad()) > math.radians(5.0)
    bench.firmware.terminate()
    bench.run(2.5)
    assert not bench.firmware.running()
    assert bench.firmware.exit_code() == 0
    assert abs(bench.world.shaft.angle_rad()) < math.radians(1.0)
