"""The autopilot with emulated devices, with time stamps on every compass sentence and servo goal."""

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
from hil.ship.scenarios import find_scenario
from hil.sim.device_factory import make_emulators
from hil.sim.goals import Goal
from hil.sim.ground_station import GroundStation
from hil.sim.process import AutopilotProcess
from hil.sim.vehicle_file import file_text, standard_vehicle
from hil.sim.world import World

COMPASS_HZ = 10.0
FREQUENCY_ERROR_PPM = 30.0  # of an ordinary crystal, so the compass is not synchronous with the computer
MILLIDEGREES = 1000
POLL_S = 0.2


class CountingCompass:
    """An NMEA compass whose n-th heading is n thousandths of a degree, so that each sentence is identifiable.

    A sentence has no transfer time, because that is not part of the latency of the autopilot.
    """

    def __init__(self) -> None:
        """Start at heading 0."""
        self._pace = Pace(1.0 / COMPASS_HZ, error_ppm=FREQUENCY_ERROR_PPM)
        self._count = 0

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return the time of the next sentence."""
        return self._pace.next_s

    def take_output(self, now_s: float) -> bytes:
        """Return the sentence that is due; a late caller gets only the last one."""
        if not self._pace.take(now_s):
            return b""
        self._count += 1
        return whole_sentence(f"HEHDT,{self._count / MILLIDEGREES:.3f},T")


GOAL_PARAMETERS = 9  # address, length, id, four bytes


class GoalRecorder:
    """Recorder of the times at which goal position frames were complete."""

    def __init__(self) -> None:
        """Start without a frame."""
        self.times_s: list[float] = []
        self._reader = PacketReader()
        self._address = int(Address.GOAL_POSITION).to_bytes(2, "little")

    def receive(self, received_s: float, data: bytes) -> None:
        """Process bytes to the servo; a frame counts only with a valid CRC and a complete goal."""
        for packet in self._reader.feed(received_s, data):
            is_sync_write = packet.is_intact and packet.instruction == Instruction.SYNC_WRITE
            is_goal = is_sync_write and packet.parameters[:2] == self._address
            if is_goal and len(packet.parameters) == GOAL_PARAMETERS:
                self.times_s.append(received_s)


class Rig:
    """Ports, devices and an autopilot, in real time; times are monotonic and count from the start of the process.

    `sentences_s[n]` is the time at which the sentence of heading n + 1 was written, `goals_s` the times at which goal
    frames were complete, `heartbeat_s` that of the first heartbeat over UDP. The context ends the process.
    """

    def __init__(self, directory: Path) -> None:
        """Start the autopilot and a ground station on a serial link, which arms it and sends a goal."""
        directory.mkdir(parents=True)
        self.out = directory
        self.sentences_s: list[float] = []
        self.heartbeat_s: float | None = None
        self._world = World(find_scenario("calm"), 1)
        devices = make_emulators(self._world, standard_vehicle(), 1)
        self._devices: dict[str, Emulator] = {
            **devices, "compass": CountingCompass(), "link": GroundStation([Goal(0.0, 0.0)])
        }  # fmt: skip
        self._goal_recorder = GoalRecorder()
        self.station = Station()
        self._lines = {name: PtyLine(directory / name) for name in self._devices}
        self._names = {line.fileno(): name for name, line in self._lines.items()}
        vehicle = directory / "vehicle.toml"
        ports = {name: str(directory / name) for name in self._lines}
        vehicle.write_text(file_text(standard_vehicle(), ports, {}))
        self._start_s = time.monotonic()
        arguments = ["run", str(vehicle), "--state", str(directory / STATE), "--link", self.station.url]
        self._autopilot = AutopilotProcess(arguments, directory / "firmware.log")

    def __enter__(self) -> Self:
        """Return the rig."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the autopilot in order, while its servo still replies, and close the ports."""
        self._autopilot.terminate()
        end_s = self.now_s() + 4.0
        while self._autopilot.running() and self.now_s() < end_s:
            self._serve_once(self.now_s() + POLL_S)
        self._autopilot.__exit__(kind, error, trace)
        for line in self._lines.values():
            line.close()
        self.station.close()

    @property
    def goals_s(self) -> list[float]:
        """The times at which goal position frames were complete."""
        return self._goal_recorder.times_s

    def now_s(self) -> float:
        """Return the seconds since the start of the autopilot."""
        return time.monotonic() - self._start_s

    def serve(self, until_s: float) -> None:
        """Serve the devices until this time; raise HilError if the autopilot ends."""
        while self.now_s() < until_s:
            self._serve_once(min(until_s, self.now_s() + POLL_S))
            if not self._autopilot.running():
                raise HilError(f"the autopilot ended early: {self._autopilot.last_output()}")

    def serve_until_alive(self, timeout_s: float) -> tuple[float, float]:
        """Serve the devices until a goal frame and a heartbeat have arrived; return their times, or raise HilError."""
        while not self.goals_s or self.heartbeat_s is None:
            if self.now_s() > timeout_s:
                raise HilError(
                    f"rudder frame or heartbeat missing after {timeout_s:g} s: {self._autopilot.last_output()}"
                )
            self.serve(self.now_s() + POLL_S / 10.0)
        return self.goals_s[0], self.heartbeat_s

    def _serve_once(self, until_s: float) -> None:
        """Send the output that is due, then wait for input until the next output."""
        due_s = self._send()
        wait_s = min(due_s, until_s) - self.now_s()
        ready = select.select([*self._names, self.station.fileno()], [], [], max(0.0, wait_s))[0]
        received_s = self.now_s()
        for descriptor in ready:
            name = self._names.get(descriptor)
            if name is None:
                self._receive_messages(received_s)
                continue
            data = self._lines[name].read()
            if name == "rudder":
                self._goal_recorder.receive(received_s, data)
            self._world.advance_to(received_s)
            self._devices[name].receive(received_s, data)

    def _receive_messages(self, received_s: float) -> None:
        kinds = [message.get_type() for message in self.station.receive()]
        if self.heartbeat_s is None and "HEARTBEAT" in kinds:
            self.heartbeat_s = received_s

    def _send(self) -> float:
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
