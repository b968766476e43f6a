"""Simulation of months at sea in one process: with the loop, power drivers, log and state of the autopilot.

The boat sails for some hours of each day, with a tick each second. For the rest of the day it is at a mooring,
disarmed, with its sensors off, and a tick every 14 s. A script defines the disturbances and the expected faults.
"""

import errno
import gc
import math
import operator
import os
import select
from array import array
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from firmware_py.assemble.logs import file_root, with_corrected_times
from firmware_py.assemble.stored_state import read_state, resume
from firmware_py.assemble.supervision import Supervision, read_endings
from firmware_py.common.angles import TWO_PI, radians
from firmware_py.common.intents import Arm, Request, SetMode
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
    RudderFeedback,
)
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import Moment
from firmware_py.core.state import State
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.log.disk import LocalDisk
from firmware_py.log.recorder import LogRecorder
from firmware_py.loop import LoopParts, run
from firmware_py.sensors.second_sensor import SecondSensor
from firmware_py.sensors.vedirect import VeDirectPower
from firmware_py.system.clock import TickTimer
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.state_directory import LOG_DIRECTORY, KeyVault
from firmware_py.system.store import Store
from hil.devices.vedirect import Kind, VeDirectEmulator
from hil.ship.disturbances import Supply
from hil.ship.power_plant import Place, PowerPlant
from support.line import FakeLine
from support.plans import START_RAD, placed

DAY_S = 86_400.0
UTC_S = 1_785_542_400.0  # midnight, the first of August 2026
SPARSE_HZ = 1.0 / 14.0
PAGE_KIB = os.sysconf("SC_PAGE_SIZE") // 1024
WARM_UP_S = 120.0  # for which the compass is on before the departure
SUPPLY = Supply(panel_w=26.0, clouds=0.55, battery_wh=400.0, load_w=4.0, charge=0.7)
SETTINGS = {
    "LOOP_RATE_HZ": 1.0,
    "BOOT_RESUME": 2.0,
    "RUD_DISARMED": 1.0,
    "LOG_FILE_MB": 4.0,
    "LOG_KEEP_MB": 48.0,
    "LOG_KEEP_DAYS": 20.0,
    "PWR_SAVE_PCT": 40.0,
}
K_1_S, T_S, SPEED_M_S = 0.05, 4.0, 0.6
SLEW_RAD_S, SERVO_V, MOVING_A, HOLDING_A = radians(30.0), 12.0, 0.25, 0.015


class PowerCutError(Exception):
    """The computer loses its power."""


class CrashError(Exception):
    """The program fails with an exception."""


RAISED = {"cut": PowerCutError, "crash": CrashError}


@dataclass(frozen=True)
class Cause:
    """A disturbed device, the times of the disturbance by the clock of the boat, and the faults that it causes."""

    device: str
    begin_s: float
    end_s: float
    faults: frozenset


@dataclass(frozen=True)
class End:
    """An end of the autopilot: cut, crash or stop, and the time for which the computer is off."""

    how: str
    at_s: float
    off_s: float = 30.0


class Ship:
    """Exact solution of Nomoto's equation, with two regular waves; the boat moves along its heading in a current."""

    def __init__(self):
        self.heading_rad = self.rate_rad_s = self.north_m = self.east_m = 0.0
        self.t_s = 0.0

    def step(self, rudder_rad, step_s):
        decayed = -math.expm1(-step_s / T_S)
        steady_rad_s = K_1_S * (rudder_rad + radians(2.0))
        mean_rad_s = steady_rad_s + (self.rate_rad_s - steady_rad_s) * decayed * T_S / step_s
        self.rate_rad_s += (steady_rad_s - self.rate_rad_s) * decayed
        middle_rad = self.heading_rad + 0.5 * mean_rad_s * step_s
        self.heading_rad += mean_rad_s * step_s
        self.t_s += step_s
        self.north_m += (SPEED_M_S * math.cos(middle_rad) + 0.05) * step_s
        self.east_m += SPEED_M_S * math.sin(middle_rad) * step_s

    def wave_rad(self):
        return radians(2.0) * math.sin(self.t_s * 0.9) + radians(1.0) * math.sin(self.t_s * 0.71 + 1.0)

    def velocity_m_s(self):
        return SPEED_M_S * math.cos(self.heading_rad) + 0.05, SPEED_M_S * math.sin(self.heading_rad)


class Gauge(VeDirectEmulator):
    """A charger or monitor that sends a measurement at each read, for the time since the previous read."""

    def output(self, now_s):
        return self._measure(now_s) if int(now_s) > int(self._previous[0]) else b""


class World:
    """Ship, servo, power plant and devices, simulated up to a time; devices in `dead` send nothing."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.ship = Ship()
        self.t_s = 0.0
        self.under_way = False
        self.dead = frozenset()
        self.shaft_rad = self.target_rad = self.servo_j = 0.0
        self.torque = False
        place = Place(math.degrees(START_RAD[0]), math.degrees(START_RAD[1]), UTC_S)
        self.plant = PowerPlant(SUPPLY, place, np.random.default_rng(seed + 1), lambda: self.servo_j)
        self.charger = Gauge(self.plant, Kind.CHARGER)
        self.monitor = Gauge(self.plant, Kind.MONITOR)

    def advance_to(self, now_s):
        while (step_s := min(1.0, now_s - self.t_s)) > 0.0:
            self.t_s += step_s
            if self.torque:
                motion_rad = min(max(self.target_rad - self.shaft_rad, -SLEW_RAD_S * step_s), SLEW_RAD_S * step_s)
                self.shaft_rad += motion_rad
                moving_s = abs(motion_rad) / SLEW_RAD_S
                self.servo_j += SERVO_V * (MOVING_A * moving_s + HOLDING_A * (step_s - moving_s))
            if self.under_way:
                self.ship.step(self.shaft_rad, step_s)
            self.plant.advance_to(self.t_s)


class Instrument:
    """Base class of devices without a byte protocol."""

    role = DeviceRole.COMPASS
    name = "compass"

    def __init__(self, world):
        self.world = world
        self.samples = []

    def fileno(self):
        return -1

    def is_sending(self):
        return self.name not in self.world.dead

    def receive(self, now_s):
        self.world.advance_to(now_s)
        if self.is_sending():
            self.samples.append(self.sample(now_s))

    def poll(self):
        samples, self.samples = self.samples, []
        return samples

    def health(self, now_s):
        return DeviceHealth(now_s, self.role, DeviceState.RUNNING if self.is_sending() else DeviceState.SILENT, 0, 0)


class Sensor(Instrument):
    """Base class of devices that are off at the mooring."""

    def is_sending(self):
        return self.world.under_way and super().is_sending()


class Compass(Sensor):
    """A compass with noise and a resolution of 0.1 deg."""

    def sample(self, now_s):
        ship = self.world.ship
        reading_rad = ship.heading_rad + ship.wave_rad() + radians(0.3) * self.world.rng.standard_normal()
        reading_rad = round(reading_rad / radians(0.1)) * radians(0.1) % TWO_PI
        return HeadingSample(now_s, reading_rad, NorthReference.TRUE, temperature_c=18.0)


class Receiver(Sensor):
    """A satellite receiver."""

    role, name = DeviceRole.POSITION, "receiver"

    def sample(self, now_s):
        ship, rng = self.world.ship, self.world.rng
        place = placed(ship.north_m + rng.standard_normal(), ship.east_m + rng.standard_normal())
        north, east = (each + 0.03 * rng.standard_normal() for each in ship.velocity_m_s())
        course_rad = math.atan2(east, north) % TWO_PI
        over_ground = (math.hypot(north, east), course_rad)
        return PositionSample(now_s, FixType.FIX_3D, *place, 2.0, *over_ground, 11, 0.9, UTC_S + now_s)


class Servo(Instrument):
    """A servo that measures the mean current since the previous feedback."""

    role, name = DeviceRole.RUDDER, "servo"

    def __init__(self, world):
        super().__init__(world)
        self.before = (world.t_s, world.servo_j)

    def sample(self, now_s):
        world, (before_s, before_j) = self.world, self.before
        self.before = (now_s, world.servo_j)
        mean_a = (world.servo_j - before_j) / (SERVO_V * (now_s - before_s)) if now_s > before_s else 0.0
        return RudderFeedback(now_s, world.shaft_rad, 25.0, SERVO_V, mean_a, torque_on=world.torque)

    def needs_prompt_io(self):
        return False

    def command(self, command, now_s):
        self.world.advance_to(now_s)
        if self.is_sending():
            self.world.target_rad, self.world.torque = command.shaft_rad, command.torque_on


class PowerLine(FakeLine):
    """The line of a charger or monitor."""

    def __init__(self, world, device, name):
        super().__init__(name=name)
        self.world, self.device_name, self.emulator = world, name, device

    def fileno(self):
        return -1

    def read(self):
        output = self.emulator.output(self.world.t_s)
        return b"" if self.device_name in self.world.dead else output


class SimulatedDisk(LocalDisk):
    """A disk with file times by the clock of the boat, which is full if "disk" is in `World.dead`."""

    def __init__(self, world, retention_days):
        super().__init__(retention_days, lambda: UTC_S + world.t_s)
        self.world = world

    def write(self, descriptor, data):
        if "disk" in self.world.dead:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(descriptor, data)

    def close(self, descriptor):
        os.utime(descriptor, (UTC_S + self.world.t_s,) * 2)
        super().close(descriptor)


class Clock:
    """Clock of the boat: a wait advances the world, and calls `act` for the script."""

    def __init__(self, world, begin_s):
        self.world, self.begin_s = world, begin_s
        self._now_s = 0.0  # not computed as a difference, which could be before the deadline by a rounding error
        self.act = lambda: None
        self.store = None

    def now_s(self):
        return self._now_s

    def utc_s(self):
        return UTC_S + self.world.t_s

    def wait(self, deadline_s, descriptors):
        if self.store.settle() and (ready := select.select(descriptors, [], [], 0.0)[0]):
            return ready
        self._now_s = max(self._now_s, deadline_s)
        self.world.advance_to(self.begin_s + self._now_s)
        self.act()
        return []


class ShiftedDevice:
    """A device with the times of a run of the program, whose clock starts at 0."""

    def __init__(self, device, begin_s):
        self._device, self._begin_s = device, begin_s
        self.fileno = device.fileno

    def receive(self, now_s):
        self._device.receive(self._begin_s + now_s)

    def poll(self):
        return [replace(sample, t_s=sample.t_s - self._begin_s) for sample in self._device.poll()]

    def health(self, now_s):
        return self._device.health(now_s)

    def command(self, command, now_s):
        self._device.command(command, self._begin_s + now_s)

    def needs_prompt_io(self):
        return self._device.needs_prompt_io()


class Flows(NamedTuple):
    """Energies [Wh] with the names of `rambler energy`."""

    solar: float = 0.0
    load: float = 0.0
    servo: float = 0.0
    charged: float = 0.0
    discharged: float = 0.0

    @classmethod
    def of(cls, totals):
        joules = (totals.charger_j, totals.load_j, totals.servo_j, totals.into_battery_j, totals.out_of_battery_j)
        return cls(*(energy_j / 3600.0 for energy_j in joules))

    def __add__(self, other):
        return Flows(*map(operator.add, self, other))

    def __sub__(self, other):
        return Flows(*map(operator.sub, self, other))


class Months:
    """A boat over many days; `run` simulates them, and records true energies, memory and disk use."""

    def __init__(self, directory, days, sailing_s, causes=(), ends=(), seed=1):
        self.directory, self.days, self.sailing_s = directory, days, sailing_s
        self.causes, self.ends = causes, [*ends, End("stop", days * DAY_S)]
        self.world = World(seed)
        self.charge = array("d", bytes(8 * (int(days * 1440.0) + 1)))  # for each minute in which the autopilot ran
        self.resident_kib = []  # for each run of the program, once an hour
        self.disk_bytes = array("q")
        self.truth = Flows()
        self.text_counts = Counter()
        self.ticks = 0

    def run(self):
        for end in self.ends:
            self._run_until(end)
            self.world.torque = False  # by the watchdog of the servo
            self.world.advance_to(end.at_s + end.off_s)
        return self

    # -------------------------------------------------------------------- one run of the program

    def _run_until(self, end):
        world = self.world
        begin_s, before = world.t_s, Flows.of(world.plant.totals)
        self.resident_kib.append(array("q"))
        with ExitStack() as opened:
            parts = self._assemble(begin_s, opened)
            parts.clock.act = lambda: self._act(parts, end)
            try:
                run(parts, lambda: world.t_s >= end.at_s)
            except PowerCutError:
                pass
            except CrashError as error:
                self._supervision.end_with_error(str(error))
                parts.recorder.close()
            else:
                self._supervision.end(restart=False)
                parts.recorder.close()
        self.truth += Flows.of(world.plant.totals) - before

    def _act(self, parts, end):
        """Apply the script for the present time, before the tick."""
        world = self.world
        now_s = world.t_s
        self.ticks += 1
        if now_s >= end.at_s:
            if end.how in RAISED:
                raise RAISED[end.how](end.how)
            return
        time_s = now_s % DAY_S
        world.under_way = DAY_S - time_s <= WARM_UP_S or time_s < self.sailing_s
        world.dead = frozenset(cause.device for cause in self.causes if cause.begin_s <= now_s < cause.end_s)
        is_sailing = time_s < self.sailing_s
        state = parts.autopilot.state
        if is_sailing != state.modes.armed and state.timing.started_s is not None:
            mode = Mode.AUTO if is_sailing else Mode.HOLD
            for intent in (Arm(armed=is_sailing), SetMode(mode)):
                parts.autopilot.decide(Request(parts.clock.now_s(), intent))
        minute = int(now_s // 60.0)
        if self.charge[minute] == 0.0:
            self.charge[minute] = world.plant.charge
            parts.recorder.writer.work()  # at sea a thread does this each second
            if minute % 60 == 30:
                self._measure_costs()

    def _measure_costs(self):
        gc.collect()
        self.resident_kib[-1].append(int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_KIB)
        logs = self.directory / LOG_DIRECTORY
        self.disk_bytes.append(sum(path.stat().st_size for path in logs.rglob("*") if path.is_file()))

    def _assemble(self, begin_s, opened):
        world, say = self.world, self._say
        clock = Clock(world, begin_s)
        store = clock.store = Store(self.directory)
        opened.callback(store.close)
        state_directory, plans = read_state(self.directory, store, say)
        values = ParameterSet()
        for name, value in SETTINGS.items():
            values = values.replaced(name, value)
        parameters = state_directory.apply_parameters(values)
        state = resume(State.at_start(parameters, plans), state_directory.resume_record(), Moment(clock.utc_s()), say)
        autopilot = Autopilot(state, state_directory)
        recorder = LogRecorder(
            self.directory / LOG_DIRECTORY,
            parameters=parameters,
            file_bytes=int(parameters["LOG_FILE_MB"] * 1e6),
            max_total_bytes=int(parameters["LOG_KEEP_MB"] * 1e6),
            utc_s=clock.utc_s(),
            software="rambler",
            background=False,
            disk=SimulatedDisk(world, parameters["LOG_KEEP_DAYS"]),
            clock_utc_s=clock.utc_s,
        )
        endpoint = Endpoint(
            [],
            autopilot,
            utc_s=clock.utc_s,
            version=Version(0, 1, 0, "", 1),
            vault=KeyVault(store),
            storage=replace(file_root(self.directory, parameters), background=False),
        )
        opened.callback(endpoint.close)
        lines = (PowerLine(world, world.charger, "charger"), PowerLine(world, world.monitor, "monitor"))
        charger, monitor = (VeDirectPower(line) for line in lines)
        parts = LoopParts(
            clock=clock,
            autopilot=autopilot,
            compass=ShiftedDevice(Compass(world), begin_s),
            position=with_corrected_times(ShiftedDevice(Receiver(world), begin_s), clock, self.directory, say),
            rudder=ShiftedDevice(Servo(world), begin_s),
            power=(charger, SecondSensor(monitor, DeviceRole.POWER_B)),
            link=endpoint,
            recorder=recorder,
            store=store,
            lines=(),
            print_event=lambda event: say(event.text),
            fault_barrier=FaultBarrier(say),
        )
        endings = read_endings(store, None, clock.utc_s(), parts.notices)
        self._supervision = Supervision(parts, endings, say, {}, None, wait=False)
        return parts

    def _say(self, text):
        self.text_counts[text] += 1


def sparse_timer(world):
    """Return a tick timer for the loop, with a tick every 14 s at the mooring."""

    class SparseTimer(TickTimer):
        def set_rate(self, rate_hz):
            super().set_rate(rate_hz if world.under_way else SPARSE_HZ)

    return SparseTimer
