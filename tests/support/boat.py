"""The autopilot as a process with emulated devices, each of which a test can disturb."""

import math
import os
import select
import signal
import time
from collections import deque
from contextlib import ExitStack
from dataclasses import replace
from itertools import count

import numpy as np

from firmware_py.log.disk import log_files
from firmware_py.system.status_file import DIRECTORIES, file_name
from firmware_py.system.store import Store
from hil.devices.bno08x_rvc import Bno08xRvcEmulator
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.feetech import FeetechEmulator
from hil.devices.hobby_servo import HobbyServo
from hil.devices.impairment import Impaired
from hil.devices.maestro import MaestroEmulator
from hil.devices.mavlink_board import MavlinkBoardEmulator
from hil.devices.mti import MtiEmulator
from hil.devices.nmea2000 import Nmea2000Emulator
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.nmea_depth import NmeaDepthEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.nmea_rudder import NmeaRudderEmulator
from hil.devices.nmea_wind import NmeaWindEmulator
from hil.devices.pni_tcm import PniTcmEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.pwm import PwmEmulator
from hil.devices.rion import RionEmulator
from hil.devices.sensor_errors import AttitudeWithError, WhereaboutsWithError
from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.devices.volz import VolzEmulator
from hil.devices.witmotion import WitmotionEmulator
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

SERVOS = {
    "dynamixel": (DynamixelEmulator, 57600),
    "volz": (VolzEmulator, 115200),
    "feetech": (FeetechEmulator, 1_000_000),
    "maestro": (lambda shaft, _rng, baud: MaestroEmulator(HobbyServo(shaft), baud=baud), 115200),
    "pwm": (lambda shaft, _rng, **_baud: PwmEmulator(HobbyServo(shaft)), 38400),
}
COMPASSES = {
    "nmea": ("nmea", NmeaCompassEmulator),
    "pni": ("pni_tcm", PniTcmEmulator),
    "mti": ("mti", MtiEmulator),
    "rion": ("rion", RionEmulator),
    "witmotion": ("witmotion", WitmotionEmulator),
    "mavlink": ("mavlink", MavlinkBoardEmulator),
    "nmea2000": ("nmea2000", Nmea2000Emulator),
}
SECOND_COMPASSES = {"nmea": NmeaCompassEmulator, "bno08x_rvc": Bno08xRvcEmulator}
GUIDED = 15
END_S = 15.0  # maximum time in which the rudder is centred and the log is closed
MAX_WAIT_S = 0.02
TAIL = 3000  # characters of the output in an error message


class Lockstep:
    """Simulated time, which makes a test repeatable; `speed` is the maximum, in multiples of real time."""

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
        """Let the autopilot compute once, and advance to its next deadline; return False after its end."""
        return self.server.serve(end_s)

    def run_out(self, _board, _process):
        while self.server.serve(paced=False):
            pass

    def close(self, _board, _process):
        self._core.close()
        if self.server is not None:
            self.server.close()


class RealTime:
    """Real time, in which cables can be unplugged."""

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
        """Advance the world, and receive the output of the autopilot."""
        now_s = min(self._now_s(), end_s)
        while board.advance(now_s):
            pass
        plugged = {port.line.fileno(): port for port in board.ports if port.line.is_plugged}
        wait_s = min(board.next_output_s(), end_s) - self._now_s()
        for descriptor in select.select(list(plugged), [], [], max(0.0, min(wait_s, MAX_WAIT_S)))[0]:
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


def vehicle_sections(driver, servo, servo_baud, second):
    """Return the texts of the sections of a vehicle file by name, with {port} for the port."""
    return {
        "compass": f'[compass]\ndriver = "{driver}"\nport = "{{port}}"\nbaud = 38400\n',
        "position": '[position]\ndriver = "nmea"\nport = "{port}"\nbaud = 9600\n',
        "rudder": f'[rudder]\ndriver = "{servo}"\nport = "{{port}}"\nbaud = {servo_baud}\n',
        "compass_b": f'[compass_b]\ndriver = "{second}"\nport = "{{port}}"\nbaud = 38400\n',
        "rudder_angle": '[rudder_angle]\ndriver = "nmea"\nport = "{port}"\nbaud = 4800\n',
        "power": '[power]\ndriver = "vedirect"\nport = "{port}"\nbaud = 19200\n',
        "power_b": '[power_b]\ndriver = "vedirect"\nport = "{port}"\nbaud = 19200\n',
        "wind": '[wind]\ndriver = "nmea"\nport = "{port}"\nbaud = 4800\n',
        "depth": '[depth]\ndriver = "nmea"\nport = "{port}"\nbaud = 4800\n',
        "link": '[link]\nurls = ["serial:{port}:57600"]\n',
    }


class Boat:
    """A simulated boat with the autopilot as a process, which can be killed and started again.

    `speed` None: real time. `without`: sections that are left out, position or link. `plans`: names and contents of
    files in the state directory at the start. `supply`: with panels, battery, charger and monitor. `second_compass`: a
    driver, or True for nmea. `instruments`: wind and depth (hil.ship.disturbances), with their sensors. `change`: a
    function that returns the changed scenario.
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
        rudder_angle=False,
        supply=None,
        instruments=None,
        without=(),
        plans=(),
        speed=math.inf,
        change=None,
    ):
        self.directory = directory
        self.time = RealTime() if speed is None else Lockstep(speed)
        sea = scenario if isinstance(scenario, Scenario) else find_scenario(scenario)
        if instruments is not None:
            wind, depth = instruments
            sea = replace(sea, disturbances=replace(sea.disturbances, wind=wind, depth=depth))
        self.world = World(change(sea) if change else sea, 1)
        rng = np.random.default_rng
        self.attitude, self.whereabouts = AttitudeWithError(self.world), WhereaboutsWithError(self.world)
        (make_servo, baud), (driver, make_compass) = SERVOS[servo], COMPASSES[compass]
        second = "nmea" if second_compass is True else second_compass
        self.servo = make_servo(self.world.shaft, rng(1), baud=baud)
        rate = {} if compass_rate_hz is None else {"rate_hz": compass_rate_hz}
        self.compass_device = make_compass(self.attitude, rng(2), **rate)
        self.compass = Impaired(self.compass_device, rng(3))
        self.gps = NmeaGpsEmulator(self.whereabouts, rng(4))
        self.station = GroundStation(parse_goals(goals) if goals else (), mode)
        self.station.texts = deque(maxlen=4096)
        devices = {"compass": self.compass, "position": self.gps, "rudder": self.servo, "link": self.station}
        sections = vehicle_sections(driver, servo, baud, second)
        if servo == "maestro":
            self.servo_line = devices["rudder"] = Impaired(self.servo, rng(9))
        if rudder_angle:
            self.rudder_sensor = devices["rudder_angle"] = NmeaRudderEmulator(self.world.rudder_rad, rng(10))
        if second_compass:
            devices["compass_b"] = self._make_second_compass(second)
        if supply is not None:
            devices |= self._make_supply(supply)
        if instruments is not None:
            devices |= self._make_instruments()
        for name in without:
            del devices[name]
        self.board = Board(self.world, devices, directory, self.time.send)
        self.lines = {port.path.name: port.line for port in self.board.ports}
        self.store(plans)
        self._vehicle = directory / "boat.toml"
        self._write_vehicle(sections, settings or {})
        self._number, self._log = count(), directory / "firmware.log"
        self.process = None
        self.rudder_history = []  # time and rudder angle at 10 Hz

    def _write_vehicle(self, sections, settings):
        """Write the vehicle file with the sections of the devices on the board, and the parameters."""
        paths = self.board.paths()
        values = "".join(f"{name} = {float(value)!r}\n" for name, value in settings.items())
        body = "".join(text.format(port=paths[name]) for name, text in sections.items() if name in paths)
        self._vehicle.write_text(f"{body}[parameters]\n{values}")

    def _make_second_compass(self, driver):
        """Return the second compass on its line."""
        rng, self.other_attitude = np.random.default_rng, AttitudeWithError(self.world)
        self.other_compass = SECOND_COMPASSES[driver](self.other_attitude, rng(5))
        self.other_line = Impaired(self.other_compass, rng(9))
        return self.other_line

    def _make_supply(self, supply):
        """Return charger and monitor of a power plant."""
        rng, place = np.random.default_rng, Place(START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S)
        self.plant = PowerPlant(supply, place, rng(6), lambda: self.servo.energy_j)
        self.charger = Impaired(VeDirectEmulator(self.plant, Kind.CHARGER), rng(7))
        self.monitor = Impaired(VeDirectEmulator(self.plant, Kind.MONITOR, phase_s=0.4), rng(8))
        return {"power": self.charger, "power_b": self.monitor}

    def _make_instruments(self):
        """Return wind sensor and echo sounder."""
        rng = np.random.default_rng
        self.wind = Impaired(NmeaWindEmulator(self.world, rng(9)), rng(10))
        self.depth = Impaired(NmeaDepthEmulator(self.world, rng(11), transducer_m=0.5), rng(12))
        return {"wind": self.wind, "depth": self.depth}

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()

    def close(self):
        self._end()
        self.board.close()
        for directory in DIRECTORIES:  # status files of killed autopilots
            (directory / file_name(self.state)).unlink(missing_ok=True)

    def _end(self):
        self.time.close(self.board, self.process)
        if self.process is not None:
            self.process.__exit__(None, None, None)

    @property
    def server(self):
        """The lockstep server, which is the clock of the autopilot."""
        return self.time.server

    @property
    def state(self):
        return self.directory / "state"

    def store(self, files):
        """Write files, given as name and content, to the state directory, like an earlier run."""
        store = Store(self.state)
        for name, content in files:
            store.save(name, content.encode())
        store.close()

    def start(self, *more):
        """Start the autopilot, again after its end; `more` are further arguments of `rambler run`."""
        number = next(self._number)
        self._log = self.directory / f"firmware{number}.log"
        arguments = ["run", str(self._vehicle), "--state", str(self.state), *more]
        arguments += self.time.arguments(self.board, self.directory / f"clock{number}")
        self.process = AutopilotProcess(arguments, self._log)
        self.time.begin(self.board, self.process)
        return self

    def kill(self):
        """Kill the autopilot, like a power cut."""
        os.kill(self.process._process.pid, signal.SIGKILL)
        self._end()

    def finish(self):
        """End the autopilot with a signal; return its logs."""
        self.process.terminate()
        self.time.run_out(self.board, self.process)
        assert self.process.wait(END_S)
        assert self.process.exit_code() == 0, self.output_text()[-TAIL:]
        return self.logs()

    def logs(self):
        return [path for _, path in sorted(log_files(self.state / "logs").items())]

    @property
    def now_s(self):
        return self.world.now_s

    def run(self, seconds):
        """Advance the world."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            assert self.time.step(self.board, end_s), self.output_text()[-TAIL:]
            if not self.rudder_history or self.now_s - self.rudder_history[-1][0] > 0.099:
                self.rudder_history.append((self.now_s, self.rudder_deg()))

    def output_text(self):
        """Return the terminal output of the autopilot."""
        return self._log.read_text()

    def run_until_written(self, text, seconds=15.0):
        """Run until the terminal output has the text once more than before."""
        count, start_s = self.output_text().count(text), self.now_s
        while self.output_text().count(text) == count:
            assert self.now_s < start_s + seconds, (
                f"{text!r} not written within {seconds} s:\n{self.output_text()[-TAIL:]}"
            )
            assert self.process.running(), self.output_text()[-TAIL:]
            self.run(0.1)

    def texts_since(self, t_s):
        """Return the texts that the ground station has received since t_s."""
        return [text for when_s, _, text in self.station.texts if when_s >= t_s - 1e-9]

    def run_until_text(self, text, seconds, since_s=None):
        """Run until the ground station has received the text; return the time that it took."""
        start_s = self.now_s if since_s is None else since_s
        while not any(received.startswith(text) for received in self.texts_since(start_s)):
            texts = f"{self.texts_since(start_s)}\n{self.output_text()[-TAIL:]}"
            assert self.now_s < start_s + seconds, f"{text!r} not received within {seconds} s: {texts}"
            self.run(0.1)
        return self.now_s - start_s

    def get_under_way(self, mode, seconds=60.0):
        """Run until the boat is armed and in this mode."""
        while self.station.mode() != f"{MODE_NAMES[mode]}, armed":
            assert self.now_s < seconds, f"{self.station.mode()} at {self.now_s} s\n{self.output_text()[-TAIL:]}"
            self.run(0.5)

    def send_command(self, command, *values):
        """Let the ground station send a command."""
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
        """Return the difference of the true heading without waves from the goal [deg]."""
        return math.degrees(math.remainder(self.world.heading_low_rad() - math.radians(goal_deg), math.tau))

    def max_rudder_deg(self, since_s):
        """Return the largest rudder angle since since_s, as a magnitude."""
        return max((abs(angle_deg) for t_s, angle_deg in self.rudder_history if t_s >= since_s), default=0.0)

    def track(self, from_s):
        """Return rows of time, north and east of the start [s, m, m], since from_s."""
        return np.array([(row[0], row[7], row[8]) for row in self.world.truth if row[0] >= from_s])
