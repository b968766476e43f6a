"""The real autopilot in lockstep on devices that a test can break, one at a time."""

from __future__ import annotations

import contextlib
import math
from collections import deque

import numpy as np
import pytest

from firmware_py.system.store import Store
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.impairment import Impaired
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.spoiled import SpoiledAttitude, SpoiledWhereabouts
from hil.devices.volz import VolzEmulator
from hil.ship.scenarios import named
from hil.sim.board import Board
from hil.sim.goals import parse_goals
from hil.sim.ground_station import MODE_NAMES, GroundStation, Order
from hil.sim.lockstep import LockstepServer
from hil.sim.pace import Pacer
from hil.sim.process import AutopilotProcess
from hil.sim.world import START_UTC_S, World

SERVOS = {"dynamixel": (DynamixelEmulator, 57600), "volz": (VolzEmulator, 115200)}
COMPASSES = {"nmea": (NmeaCompassEmulator, "nmea"), "pni": (PniTcmEmulator, "pni_tcm")}
GUIDED = 15


class FaultBench:
    """A boat in the tank, armed and under way; `run` lets time pass, `until` waits for a word of the autopilot."""

    def __init__(
        self,
        directory,
        *,
        settings=None,
        scenario="tank",
        compass="nmea",
        servo="dynamixel",
        goals="0:0",
        mode=GUIDED,
        second_compass=False,
        plans=(),
        speed=math.inf,
        change=None,
    ):
        self.directory = directory
        self.world = World(change(named(scenario)) if change else named(scenario), 1)
        rng = np.random.default_rng
        self.attitude, self.whereabouts = SpoiledAttitude(self.world), SpoiledWhereabouts(self.world)
        make_servo, baud = SERVOS[servo]
        make_compass, driver = COMPASSES[compass]
        self.servo = make_servo(self.world.shaft, rng(1), baud=baud)
        self.compass_device = make_compass(self.attitude, rng(2))
        self.compass = Impaired(self.compass_device, rng(3))
        self.gps = NmeaGpsEmulator(self.whereabouts, rng(4))
        self.station = GroundStation(parse_goals(goals) if goals else (), mode)
        self.station.texts = deque(maxlen=4096)
        devices = {"compass": self.compass, "position": self.gps, "rudder": self.servo, "link": self.station}
        second = ""
        if second_compass:
            self.other_attitude = SpoiledAttitude(self.world)
            devices["compass_b"] = NmeaCompassEmulator(self.other_attitude, rng(5))
            second = '[compass_b]\ndriver = "nmea"\nport = "{ports[compass_b]}"\nbaud = 38400\n'
        self.board = Board(self.world, devices, directory, PtyLine.deliver)
        self.lines = {port.path.name: port.line for port in self.board.ports}
        ports = self.board.paths()
        state = directory / "state"
        store = Store(state)
        for name, content in plans:
            store.save(name, content.encode())
        store.close()
        values = "".join(f"{name} = {float(value)!r}\n" for name, value in (settings or {}).items())
        vehicle = directory / "boat.toml"
        vehicle.write_text(
            f'[compass]\ndriver = "{driver}"\nport = "{ports["compass"]}"\nbaud = 38400\n'
            f'[position]\ndriver = "nmea"\nport = "{ports["position"]}"\nbaud = 9600\n'
            f'[rudder]\ndriver = "{servo}"\nport = "{ports["rudder"]}"\nbaud = {baud}\n'
            + second.format(ports=ports)
            + f'[link]\nurls = ["serial:{ports["link"]}:57600"]\n[parameters]\n{values}'
        )
        self.server = LockstepServer(directory / "clock", self.board, Pacer(speed))
        arguments = ["run", str(vehicle), "--state", str(state), "--lockstep", str(directory / "clock")]
        self.firmware = AutopilotProcess(arguments, directory / "firmware.log")
        self.trail = []  # time and rudder angle, every tenth of a second
        try:
            self.server.accept(self.firmware.running, START_UTC_S)
        except Exception:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()

    def close(self):
        self.server.close()
        self.firmware.__exit__(None, None, None)
        self.board.close()

    @property
    def now_s(self):
        return self.world.now_s

    def run(self, seconds):
        """Let the world go on."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            assert self.server.serve(end_s), self.words()
            if not self.trail or self.now_s - self.trail[-1][0] > 0.099:
                self.trail.append((self.now_s, self.rudder_deg()))

    def texts_since(self, t_s):
        return [text for when_s, _, text in self.station.texts if when_s >= t_s - 1e-9]

    def until(self, text, seconds, since_s=None):
        """Run until the autopilot says a text; return how long it took."""
        begin_s = self.now_s if since_s is None else since_s
        while not any(said.startswith(text) for said in self.texts_since(begin_s)):
            told = self.texts_since(begin_s)
            assert self.now_s < begin_s + seconds, f"{text!r} not said within {seconds} s: {told}\n{self.words()}"
            self.run(0.1)
        return self.now_s - begin_s

    def under_way(self, mode, seconds=60.0):
        """Run until she is armed and in a mode."""
        while self.station.mode() != f"{MODE_NAMES[mode]}, armed":
            assert self.now_s < seconds, f"{self.station.mode()} at {self.now_s} s\n{self.words()}"
            self.run(0.5)

    def order(self, command, *values):
        """Have the operator give one more command."""
        self.station._open.append(Order("order", self.now_s, command, values))
        self.station._plan(self.now_s)

    def mode(self):
        """The mode, once a heartbeat of now has told it."""
        self.run(1.1)
        return self.station.mode().split(",")[0]

    def rudder_deg(self):
        return math.degrees(self.world.rudder_rad())

    def command_deg(self):
        return math.degrees(self.world.shaft.target_rad)

    def heading_error_deg(self, goal_deg=0.0):
        """How far her true low-frequency heading is off the goal."""
        return math.degrees(math.remainder(self.world.heading_low_rad() - math.radians(goal_deg), math.tau))

    def widest_deg(self, since_s):
        """The largest rudder angle since a moment."""
        return max((abs(angle_deg) for t_s, angle_deg in self.trail if t_s >= since_s), default=0.0)

    def words(self):
        return (self.directory / "firmware.log").read_text()[-3000:]

    def finish(self):
        """End the autopilot in good order and return its logs."""
        self.firmware.terminate()
        while self.server.serve(paced=False):
            pass
        assert self.firmware.wait(15.0)
        assert self.firmware.exit_code() == 0, self.words()
        return sorted((self.directory / "state" / "logs").glob("*.BIN"))


@pytest.fixture
def fault_bench(tmp_path):
    """Make benches that are closed whatever becomes of the test."""
    with contextlib.ExitStack() as open_benches:

        def make(name="boat", **options):
            (tmp_path / name).mkdir()
            return open_benches.enter_context(FaultBench(tmp_path / name, **options))

        yield make
