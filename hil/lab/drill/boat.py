"""A simulated boat with the real autopilot in lockstep, whose devices accept faults."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_py.common.angles import degrees, radians, wrap_pi
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.emulator import Emulator
from hil.devices.impairment import Impaired
from hil.devices.nmea_compass import NmeaCompassEmulator
from hil.devices.nmea_depth import NmeaDepthEmulator
from hil.devices.nmea_gps import NmeaGpsEmulator
from hil.devices.nmea_wind import NmeaWindEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.sensor_errors import AttitudeWithError, WhereaboutsWithError
from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.errors import HilError
from hil.ship.disturbances import Supply
from hil.ship.noise import Stream, generator
from hil.ship.power_plant import Place, PowerPlant
from hil.ship.scenarios import Scenario
from hil.sim.board import Board
from hil.sim.goals import Goal
from hil.sim.ground_station import CHANGE_HEADING, GUIDED, HEADING_TYPE, GroundStation, Order
from hil.sim.lockstep import LockstepServer
from hil.sim.pace import Pacer
from hil.sim.process import END_TIMEOUT_S, AutopilotProcess
from hil.sim.reserved_cores import reserved_cores
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S, World

SET_MODE = 176  # MAV_CMD_DO_SET_MODE
# section of the vehicle file -> driver and baud rate; only sections of fitted devices are written
SECTIONS = {
    "compass": ("nmea", 38400),
    "compass_b": ("nmea", 38400),
    "position": ("nmea", 9600),
    "rudder": ("dynamixel", 57600),
    "power": ("vedirect", 19200),
    "power_b": ("vedirect", 19200),
    "wind": ("nmea", 4800),
    "depth": ("nmea", 4800),
}


class DrillBoat:
    """A simulated boat for fault drills; a context manager that starts and ends the autopilot process.

    `fitted`: names of additional devices ("compass_b", "supply", "instruments"). `plans`: plan files that are loaded
    before the start. `goals`: goals for GUIDED. `world`: replaces a new world. The time of the world advances only in
    `run`, so that a drill is reproducible.
    """

    def __init__(
        self,
        directory: Path,
        scenario: Scenario,
        *,
        seed: int = 1,
        mode: int = GUIDED,
        settings: Mapping[str, float] | None = None,
        fitted: tuple[str, ...] = (),
        plans: tuple[Path, ...] = (),
        goals: tuple[Goal, ...] = (Goal(0.0, 0.0),),
        world: World | None = None,
    ) -> None:
        """Build the boat in an existing directory."""
        self.directory = directory
        self.state = directory / "state"
        self.world = World(scenario, seed) if world is None else world
        self.attitude, self.whereabouts = AttitudeWithError(self.world), WhereaboutsWithError(self.world)
        self.servo = DynamixelEmulator(self.world.shaft, generator(seed, Stream.RUDDER))
        self.compass = Impaired(
            NmeaCompassEmulator(self.attitude, generator(seed, Stream.COMPASS)), generator(seed, Stream.PHASES)
        )
        self.receiver = NmeaGpsEmulator(self.whereabouts, generator(seed, Stream.POSITION))
        self.receiver_line = Impaired(self.receiver, generator(seed, Stream.GAPS))
        self.servo_line = Impaired(self.servo, generator(seed, Stream.PHASES))
        self.station = GroundStation(goals if mode == GUIDED else (), mode)
        devices: dict[str, Emulator] = {
            "compass": self.compass,
            "position": self.receiver_line,
            "rudder": self.servo_line,
            "link": self.station,
        }
        if "compass_b" in fitted:
            self.attitude_b = AttitudeWithError(self.world)
            devices["compass_b"] = NmeaCompassEmulator(self.attitude_b, generator(seed, Stream.PHASES))
        if "supply" in fitted:
            devices |= self._make_supply(seed)
        if "instruments" in fitted:
            devices |= {
                "wind": NmeaWindEmulator(self.world, generator(seed, Stream.WIND)),
                "depth": NmeaDepthEmulator(self.world, generator(seed, Stream.DEPTH)),
            }
        self._stack = ExitStack()
        self._stack.enter_context(reserved_cores())
        self.board = self._stack.enter_context(Board(self.world, devices, directory, PtyLine.post))
        self.lines = {port.path.name: port.line for port in self.board.ports}
        self._vehicle = directory / "vehicle.toml"
        self._vehicle.write_text(_vehicle_text(self.board.paths(), settings or {}), encoding="utf-8")
        self.state.mkdir()
        for plan in plans:
            arguments = [sys.executable, "-m", "firmware_py", "plan", "load", str(plan), "--state", str(self.state)]
            subprocess.run(arguments, check=True, capture_output=True)
        self.pacer = Pacer(math.inf)
        self._starts = 0
        self.goal_deg = self.goal_s = 0.0
        self.mode_before = ""  # the mode before the fault
        self.final_rudder_deg = self.max_rudder_deg = 0.0  # angle when the autopilot ended; largest magnitude
        self.errors_deg: list[tuple[float, float]] = []  # time, and heading minus goal, ten times per second

    def _make_supply(self, seed: int) -> dict[str, Emulator]:
        """Create panels, battery, charger and battery monitor."""
        place = Place(START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S)
        self.plant = PowerPlant(Supply(), place, generator(seed, Stream.CLOUDS), lambda: self.servo.energy_j)
        self.monitor = Impaired(VeDirectEmulator(self.plant, Kind.MONITOR, phase_s=0.4), generator(seed, Stream.POWER))
        return {"power": VeDirectEmulator(self.plant, Kind.CHARGER), "power_b": self.monitor}

    def __enter__(self) -> Self:
        """Start the autopilot."""
        self.start()
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the autopilot and release the ports."""
        self.server.close()
        self._process.__exit__(error_type, error, trace)
        self._stack.close()

    def start(self) -> None:
        """Start an autopilot with the present state directory."""
        self._starts += 1
        clock = self.directory / f"clock{self._starts}"
        self.server = LockstepServer(clock, self.board, self.pacer)
        arguments = ["run", str(self._vehicle), "--state", str(self.state), "--lockstep", str(clock)]
        self._process = AutopilotProcess(arguments, self.directory / f"firmware{self._starts}.log")
        self.server.accept(self._process.running, START_UTC_S + self.world.now_s)

    def end(self) -> None:
        """Send SIGTERM and wait until the autopilot ends; raise HilError if it does not end in time."""
        self._process.terminate()
        end_s = self.now_s + END_TIMEOUT_S
        while self.server.serve(end_s):
            if self.now_s >= end_s:
                raise HilError(f"autopilot: still running {END_TIMEOUT_S:g} s after SIGTERM")
        self._process.wait(END_TIMEOUT_S)
        self.final_rudder_deg = self.rudder_deg()
        self.server.close()

    def kill(self) -> None:
        """Kill the autopilot, as by a loss of power."""
        self._process.kill()
        for port in self.board.ports:
            if isinstance(port.line, PtyLine):
                port.line.release_exclusive_use()
        self.server.close()

    def run(self, seconds: float) -> None:
        """Advance the world; raise HilError if the autopilot ends."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            if not self.server.serve(end_s):
                raise HilError(f"the autopilot has ended: {self._process.last_output()}")
            if not self.errors_deg or self.now_s - self.errors_deg[-1][0] > 0.099:
                self.errors_deg.append((self.now_s, self.error_deg()))
                self.max_rudder_deg = max(self.max_rudder_deg, abs(self.rudder_deg()))

    def unplug(self, name: str) -> None:
        """Unplug a device."""
        line = self.lines[name]
        if isinstance(line, PtyLine):
            line.unplug()

    def plug(self, name: str) -> None:
        """Plug a device in again."""
        line = self.lines[name]
        if isinstance(line, PtyLine):
            line.plug()

    @property
    def now_s(self) -> float:
        """Return the time of the world."""
        return self.world.now_s

    def order(self, text: str, command: int, *values: float) -> None:
        """Send a command of the operator."""
        self.station.order(Order(text, self.now_s, command, values), self.now_s)

    def steer(self, goal_deg: float) -> None:
        """Command a heading."""
        self.goal_deg, self.goal_s = goal_deg, self.now_s
        self.order(f"heading {goal_deg:g}", CHANGE_HEADING, HEADING_TYPE, goal_deg % 360.0)

    def set_mode(self, mode: int) -> None:
        """Command a mode."""
        self.order(f"mode {mode}", SET_MODE, 1.0, float(mode))

    def start_commands(self, seconds: float = 60.0) -> bool:
        """Run until the first commands of the operator are accepted; return whether this happened within `seconds`."""
        while any(order.accepted_s is None for order in self.station.orders):
            if self.now_s > seconds:
                return False
            self.run(0.5)
        return True

    def report_time(self, text: str, since_s: float) -> float | None:
        """Return the time of the first message since `since_s` that starts with `text`, or None."""
        since_s -= 1e-9
        return next((t_s for t_s, _, sent in self.station.texts if t_s >= since_s and sent.startswith(text)), None)

    def await_report(self, text: str, within_s: float, since_s: float) -> float | None:
        """Run until a message since `since_s` starts with `text`; return its time, or None after `within_s`."""
        while (at_s := self.report_time(text, since_s)) is None and self.now_s < since_s + within_s:
            self.run(0.1)
        return at_s

    def store_mode(self) -> None:
        """Store the mode of the last heartbeat."""
        self.mode_before = self.station.mode().split(",")[0]

    def mode(self) -> str:
        """Run until the next heartbeat and return its mode."""
        self.run(1.1)
        return self.station.mode().split(",")[0]

    def steers_by_course(self) -> bool:
        """Return whether the last report of the heading source names the course over ground."""
        sources = [text for _, _, text in self.station.texts if text.startswith("Heading source")]
        return bool(sources) and sources[-1].startswith("Heading source: course")

    def rudder_deg(self) -> float:
        """Return the true rudder angle."""
        return degrees(self.world.rudder_rad())

    def error_deg(self) -> float:
        """Return heading minus goal, without wave-frequency yaw."""
        return degrees(wrap_pi(self.world.heading_low_rad() - radians(self.goal_deg)))


def _vehicle_text(ports: Mapping[str, str], settings: Mapping[str, float]) -> str:
    sections = [
        f'[{name}]\ndriver = "{driver}"\nport = "{ports[name]}"\nbaud = {baud}\n'
        for name, (driver, baud) in SECTIONS.items()
        if name in ports
    ]
    values = "".join(f"{name} = {float(value)!r}\n" for name, value in settings.items())
    return "".join([*sections, f'[link]\nurls = ["serial:{ports["link"]}:57600"]\n', f"[parameters]\n{values}"])
