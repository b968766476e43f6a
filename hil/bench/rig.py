"""The autopilot on a board whose compass and servo the bench itself plays, with a stamp on every sentence and goal."""

from __future__ import annotations

import math
import select
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from hil.bench.station import Station
from hil.bench.tick import STATE
from hil.devices.dynamixel_frame import Instruction, PacketReader
from hil.devices.dynamixel_table import Address
from hil.devices.emulator import Emulator
from hil.devices.nmea_text import whole_sentence
from hil.devices.pty_line import PtyLine
from hil.devices.timing import Pace
from hil.errors import HilError
from hil.ship.scenarios import named
from hil.sim.device_factory import emulators
from hil.sim.goals import Goal
from hil.sim.ground_station import GroundStation
from hil.sim.process import AutopilotProcess
from hil.sim.vehicle_file import file_text, standard_vehicle
from hil.sim.world import World

COMPASS_HZ = 10.0
FREQUENCY_ERROR_PPM = 30.0  # an ordinary crystal: it runs free of our clock
MILLIDEGREES = 1000
LOOK_S = 0.2


class CountingCompass:
    """An NMEA compass whose n-th heading is n thousandths of a degree, so that each sentence can be told.

    A sentence is on the line at once: what its transfer takes is the line's, not the autopilot's.
    """

    def __init__(self) -> None:
        """Start at heading 0."""
        self._pace = Pace(1.0 / COMPASS_HZ, error_ppm=FREQUENCY_ERROR_PPM)
        self._count = 0

    def receive(self, now_s: float, data: bytes) -> None:
        """Listen to nobody."""

    def next_output_s(self) -> float:
        """When the next sentence is due."""
        return self._pace.next_s

    def take_output(self, now_s: float) -> bytes:
        """Return the sentence that is due; a late caller gets the last one only."""
        if not self._pace.take(now_s):
            return b""
        self._count += 1
        return whole_sentence(f"HEHDT,{self._count / MILLIDEGREES:.3f},T")


GOAL_PARAMETERS = 9  # address, length, id, four bytes


class GoalWatch:
    """Notes when each goal position frame was complete."""

    def __init__(self) -> None:
        """Start with none."""
        self.times_s: list[float] = []
        self._reader = PacketReader()
        self._address = int(Address.GOAL_POSITION).to_bytes(2, "little")

    def take(self, heard_s: float, data: bytes) -> None:
        """Take what the servo hears; a frame counts only with a right CRC and a whole goal."""
        for packet in self._reader.feed(heard_s, data):
            sync_write = packet.intact and packet.instruction == Instruction.SYNC_WRITE
            goal = sync_write and packet.parameters[:2] == self._address
            if goal and len(packet.parameters) == GOAL_PARAMETERS:
                self.times_s.append(heard_s)


class Rig:
    """Ports, devices and an autopilot, in real time; times are monotonic and count from the start of the process.

    `sentences_s[n]` is when the sentence of heading n + 1 was written, `goals_s` when goal
    frames were complete, `heartbeat_s` when the first heartbeat came over UDP. A context that leaves no process behind.
    """

    def __init__(self, directory: Path) -> None:
        """Start the autopilot, armed and steered by an operator on a serial link."""
        directory.mkdir(parents=True)
        self.out = directory
        self.sentences_s: list[float] = []
        self.heartbeat_s: float | None = None
        self._world = World(named("calm"), 1)
        devices = emulators(self._world, standard_vehicle(), 1)
        self._devices: dict[str, Emulator] = {
            **devices, "compass": CountingCompass(), "link": GroundStation([Goal(0.0, 0.0)])
        }  # fmt: skip
        self._watch = GoalWatch()
        self.station = Station()
        self._lines = {name: PtyLine(directory / name) for name in self._devices}
        self._names = {line.fileno(): name for name, line in self._lines.items()}
        vehicle = directory / "vehicle.toml"
        ports = {name: str(directory / name) for name in self._lines}
        vehicle.write_text(file_text(standard_vehicle(), ports, {}))
        self._start_s = time.monotonic()
        arguments = ["run", str(vehicle), "--state", str(directory / STATE), "--link", self.station.url]
        self._firmware = AutopilotProcess(arguments, directory / "firmware.log")

    def __enter__(self) -> Self:
        """Return the rig."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the autopilot in good order, with its servo still answering, and close the ports."""
        self._firmware.terminate()
        end_s = self.now_s() + 4.0
        while self._firmware.running() and self.now_s() < end_s:
            self._turn(self.now_s() + LOOK_S)
        self._firmware.__exit__(kind, error, trace)
        for line in self._lines.values():
            line.close()
        self.station.close()

    @property
    def goals_s(self) -> list[float]:
        """When each goal position frame was complete."""
        return self._watch.times_s

    def now_s(self) -> float:
        """Seconds since the start of the autopilot."""
        return time.monotonic() - self._start_s

    def serve(self, until_s: float) -> None:
        """Play the devices until then; HilError when the autopilot ends."""
        while self.now_s() < until_s:
            self._turn(min(until_s, self.now_s() + LOOK_S))
            if not self._firmware.running():
                raise HilError(f"the autopilot ended early: {self._firmware.last_output()}")

    def serve_until_alive(self, most_s: float) -> tuple[float, float]:
        """Play the devices until a goal frame and a heartbeat have come; return when, or raise HilError."""
        while not self.goals_s or self.heartbeat_s is None:
            if self.now_s() > most_s:
                raise HilError(f"no rudder frame or no heartbeat within {most_s:g} s: {self._firmware.last_output()}")
            self.serve(self.now_s() + LOOK_S / 10.0)
        return self.goals_s[0], self.heartbeat_s

    def _turn(self, until_s: float) -> None:
        """Say what is due, then take what comes until the next is."""
        due_s = self._speak()
        wait_s = min(due_s, until_s) - self.now_s()
        ready = select.select([*self._names, self.station.fileno()], [], [], max(0.0, wait_s))[0]
        heard_s = self.now_s()
        for descriptor in ready:
            name = self._names.get(descriptor)
            if name is None:
                self._take_messages(heard_s)
                continue
            data = self._lines[name].read()
            if name == "rudder":
                self._watch.take(heard_s, data)
            self._world.advance_to(heard_s)
            self._devices[name].receive(heard_s, data)

    def _take_messages(self, heard_s: float) -> None:
        kinds = [message.get_type() for message in self.station.receive()]
        if self.heartbeat_s is None and "HEARTBEAT" in kinds:
            self.heartbeat_s = heard_s

    def _speak(self) -> float:
        due_s = math.inf
        for name, device in self._devices.items():
            if device.next_output_s() <= self.now_s():
                self._world.advance_to(self.now_s())
                if data := device.take_output(self.now_s()):
                    if name == "compass":
                        self.sentences_s.append(self.now_s())
                    self._lines[name].write(data)
            due_s = min(due_s, device.next_output_s())
        return due_s
