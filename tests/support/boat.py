"""The real autopilot as a process on emulated devices, each of which a test can break."""

import math
import os
import select
import signal
import time
from collections import deque
from contextlib import ExitStack
from itertools import count

import numpy as np

from firmware_py.log.disk import log_files
from firmware_py.system.status_file import DIRECTORIES, file_name
from firmware_py.system.store import Store
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.impairment import Impaired
from hil.devices.mti import MtiEmulator
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.sensor_errors import AttitudeWithError, WhereaboutsWithError
from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.devices.volz import VolzEmulator
from hil.ship.power_plant import Place, PowerPlant
from hil.ship.scenarios import Scenario, find_scenario
from hil.sim.board import Board
from hil.sim.goals import parse_goals
from hil.sim.ground_station import MODE_NAMES, GroundStation, Order
from hil.sim.lockstep import LockstepServer
from hil.sim.pace import Pacer
from hil.sim.process import AutopilotProcess
from hil.sim.reserved_cores import reserved_cores
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S, World

SERVOS = {"dynamixel": (DynamixelEmulator, 57600), "volz": (VolzEmulator, 115200)}
COMPASSES = {"nmea": ("nmea", NmeaCompassEmulator), "pni": ("pni_tcm", PniTcmEmulator), "mti": ("mti", MtiEmulator)}
GUIDED = 15
END_S = 15.0  # the rudder goes amidships, the log is written out
LOOK_S = 0.02
TAIL = 3000


class Lockstep:
    """Time that the test gives, the same each time it runs; `speed` is how many times real time at most."""

    send = staticmethod(PtyLine.post)

    def __init__(self, speed):
        self._speed = speed
        self._core = ExitStack()
        self.server = None

    def arguments(self, board, path):
        if self.server is None:
            self._core.enter_context(reserved_cores())
        self.server = LockstepServer(path, board, Pacer(self._speed))
        return ["--lockstep", str(path)]

    def begin(self, board, process):
        self.server.accept(process.running, START_UTC_S + board.world.now_s)

    def step(self, _board, end_s):
        """Let the autopilot compute once and time go on to its next deadline; False when it has gone."""
        return self.server.serve(end_s)

    def run_out(self, _board, _process):
        while self.server.serve(paced=False):
            pass

    def close(self, _board, _process):
        self._core.close()
        if self.server is not None:
            self.server.close()


class RealTime:
    """The machine's own time; cables may be pulled while it goes."""

    send = staticmethod(PtyLine.write)

    def __init__(self):
        self._start_s = 0.0

    def arguments(self, _board, _path):
        return []

    def begin(self, board, _process):
        self._start_s = time.monotonic() - board.world.now_s

    def _now_s(self):
        return time.monotonic() - self._start_s

    def step(self, board, end_s):
        """Do what is due and wait a moment for what the autopilot writes."""
        now_s = min(self._now_s(), end_s)
        while board.advance(now_s):
            pass
        plugged = {port.line.fileno(): port for port in board.ports if port.line.is_plugged}
        wait_s = min(board.next_output_s(), end_s) - self._now_s()
        for descriptor in select.select(list(plugged), [], [], max(0.0, min(wait_s, LOOK_S)))[0]:
            board.receive(plugged[descriptor], plugged[descriptor].line.read())
        return True

    def run_out(self, board, process):
        end_s = self._now_s() + END_S
        while process.running() and self._now_s() < end_s:
            self.step(board, end_s)

    def close(self, board, process):
        if process is not None:
            process.terminate()
            self.run_out(board, process)


class Boat:
    """A boat at sea with the real autopilot aboard, which may be killed and started again.

    `speed` is None in real time. `without` leaves out position, link or both. `plans` are files
    that the state directory holds from the start, by name; `supply` gives panels, battery, charger and monitor.
    """

    def __init__(
        self,
        directory,
        *,
        settings=None,
        scenario="tank",
        compass="nmea",
        compass_rate_hz=None,
        servo="dynamixel",
        goals="0:0",
        mode=GUIDED,
        second_compass=False,
        supply=None,
        without=(),
        plans=(),
        speed=math.inf,
        change=None,
    ):
        self.directory = directory
        self.time = RealTime() if speed is None else Lockstep(speed)
        sea = scenario if isinstance(scenario, Scenario) else find_scenario(scenario)
        self.world = World(change(sea) if change else sea, 1)
        rng = np.random.default_rng
        self.attitude, self.whereabouts = AttitudeWithError(self.world), WhereaboutsWithError(self.world)
        make_servo, baud = SERVOS[servo]
        driver, make_compass = COMPASSES[compass]
        self.servo = make_servo(self.world.shaft, rng(1), baud=baud)
        rate = {} if compass_rate_hz is None else {"rate_hz": compass_rate_hz}
        self.compass_device = make_compass(self.attitude, rng(2), **rate)
        self.compass = Impaired(self.compass_device, rng(3))
        self.gps = NmeaGpsEmulator(self.whereabouts, rng(4))
        self.station = GroundStation(parse_goals(goals) if goals else (), mode)
        self.station.texts = deque(maxlen=4096)
        devices = {"compass": self.compass, "position": self.gps, "rudder": self.servo, "link": self.station}
        sections = {
            "compass": f'[compass]\ndriver = "{driver}"\nport = "{{port}}"\nbaud = 38400\n',
            "position": '[position]\ndriver = "nmea"\nport = "{port}"\nbaud = 9600\n',
            "rudder": f'[rudder]\ndriver = "{servo}"\nport = "{{port}}"\nbaud = {baud}\n',
            "compass_b": '[compass_b]\ndriver = "nmea"\nport = "{port}"\nbaud = 38400\n',
            "power": '[power]\ndriver = "vedirect"\nport = "{port}"\nbaud = 19200\n',
            "power_b": '[power_b]\ndriver = "vedirect"\nport = "{port}"\nbaud = 19200\n',
            "link": '[link]\nurls = ["serial:{port}:57600"]\n',
        }
        if second_compass:
            self.other_attitude = AttitudeWithError(self.world)
            devices["compass_b"] = NmeaCompassEmulator(self.other_attitude, rng(5))
        if supply is not None:
            place = Place(START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S)
            self.plant = PowerPlant(supply, place, rng(6), lambda: self.servo.energy_j)
            self.charger = Impaired(VeDirectEmulator(self.plant, Kind.CHARGER), rng(7))
            self.monitor = Impaired(VeDirectEmulator(self.plant, Kind.MONITOR, phase_s=0.4), rng(8))
            devices |= {"power": self.charger, "power_b": self.monitor}
        for name in without:
            del devices[name]
        self.board = Board(self.world, devices, directory, self.time.send)
        self.lines = {port.path.name: port.line for port in self.board.ports}
        paths = self.board.paths()
        self.store(plans)
        values = "".join(f"{name} = {float(value)!r}\n" for name, value in (settings or {}).items())
        body = "".join(text.format(port=paths[name]) for name, text in sections.items() if name in paths)
        self._vehicle = directory / "boat.toml"
        self._vehicle.write_text(f"{body}[parameters]\n{values}")
        self._number = count()
        self._log = directory / "firmware.log"
        self.process = None
        self.trail = []  # time and rudder angle, every tenth of a second

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()

    def close(self):
        self._end()
        self.board.close()
        for directory in DIRECTORIES:  # what one that was killed has said last
            (directory / file_name(self.state)).unlink(missing_ok=True)

    def _end(self):
        self.time.close(self.board, self.process)
        if self.process is not None:
            self.process.__exit__(None, None, None)

    @property
    def server(self):
        """The clock that the autopilot has in lockstep."""
        return self.time.server

    @property
    def state(self):
        return self.directory / "state"

    def store(self, files):
        """Put files, by name and content, into the state directory, as an earlier run leaves them there."""
        store = Store(self.state)
        for name, content in files:
            store.save(name, content.encode())
        store.close()

    def start(self, *more):
        """Start an autopilot, the first or one more; `more` are further arguments of `rambler run`."""
        number = next(self._number)
        self._log = self.directory / f"firmware{number}.log"
        arguments = ["run", str(self._vehicle), "--state", str(self.state), *more]
        arguments += self.time.arguments(self.board, self.directory / f"clock{number}")
        self.process = AutopilotProcess(arguments, self._log)
        self.time.begin(self.board, self.process)
        return self

    def kill(self):
        """End the autopilot as a power cut does."""
        os.kill(self.process._process.pid, signal.SIGKILL)
        self._end()

    def finish(self):
        """End the autopilot in good order and return its logs."""
        self.process.terminate()
        self.time.run_out(self.board, self.process)
        assert self.process.wait(END_S)
        assert self.process.exit_code() == 0, self.words()[-TAIL:]
        return self.logs()

    def logs(self):
        return [path for _, path in sorted(log_files(self.state / "logs").items())]

    @property
    def now_s(self):
        return self.world.now_s

    def run(self, seconds):
        """Let the world go on."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            assert self.time.step(self.board, end_s), self.words()[-TAIL:]
            if not self.trail or self.now_s - self.trail[-1][0] > 0.099:
                self.trail.append((self.now_s, self.rudder_deg()))

    def words(self):
        """What the autopilot has written to its terminal."""
        return self._log.read_text()

    def until_written(self, text, seconds=15.0):
        """Run until the autopilot has written a text to its terminal once more than before."""
        before, begin_s = self.words().count(text), self.now_s
        while self.words().count(text) == before:
            assert self.now_s < begin_s + seconds, f"{text!r} not written within {seconds} s:\n{self.words()[-TAIL:]}"
            assert self.process.running(), self.words()[-TAIL:]
            self.run(0.1)

    def texts_since(self, t_s):
        """The texts that the ground station has had since a moment."""
        return [text for when_s, _, text in self.station.texts if when_s >= t_s - 1e-9]

    def until(self, text, seconds, since_s=None):
        """Run until the ground station has a text; return how long it took."""
        begin_s = self.now_s if since_s is None else since_s
        while not any(output.startswith(text) for output in self.texts_since(begin_s)):
            assert self.now_s < begin_s + seconds, (
                f"{text!r} not said within {seconds} s: {self.texts_since(begin_s)}\n{self.words()[-TAIL:]}"
            )
            self.run(0.1)
        return self.now_s - begin_s

    def under_way(self, mode, seconds=60.0):
        """Run until the boat is armed and in a mode."""
        while self.station.mode() != f"{MODE_NAMES[mode]}, armed":
            assert self.now_s < seconds, f"{self.station.mode()} at {self.now_s} s\n{self.words()[-TAIL:]}"
            self.run(0.5)

    def order(self, command, *values):
        """Have the operator give one more command."""
        self.station.order(Order("order", self.now_s, command, values), self.now_s)

    def mode(self):
        """Return the mode of a new heartbeat."""
        self.run(1.1)
        return self.station.mode().split(",")[0]

    def rudder_deg(self):
        return math.degrees(self.world.rudder_rad())

    def command_deg(self):
        return math.degrees(self.world.shaft.target_rad)

    def heading_error_deg(self, goal_deg=0.0):
        """How far the true low-frequency heading is off the goal."""
        return math.degrees(math.remainder(self.world.heading_low_rad() - math.radians(goal_deg), math.tau))

    def widest_deg(self, since_s):
        """The largest rudder angle since a moment."""
        return max((abs(angle_deg) for t_s, angle_deg in self.trail if t_s >= since_s), default=0.0)

    def track(self, from_s):
        """Time, north and east of the start [s, m, m] in rows, since a moment."""
        return np.array([(row[0], row[7], row[8]) for row in self.world.truth if row[0] >= from_s])
