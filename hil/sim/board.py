"""The board: the serial lines of the autopilot and the device behind each of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from hil.devices.emulator import Emulator
from hil.devices.network_line import NetworkLine
from hil.devices.pty_line import PtyLine
from hil.devices.pwm import PwmEmulator
from hil.devices.pwm_channel import PwmChannel
from hil.devices.serial_line import SerialLine
from hil.sim.world import World

Line = PtyLine | SerialLine | NetworkLine | PwmChannel
Send = Callable[[PtyLine, bytes], object]


@dataclass(frozen=True, slots=True)
class Port:
    """A line, its path, whose name is that of the device, and the device behind it."""

    path: Path
    line: Line
    emulator: Emulator

    @property
    def address(self) -> str:
        """The port of the vehicle file, by which the autopilot opens the line."""
        return self.line.address if isinstance(self.line, PwmChannel) else str(self.path)


class Board:
    """Advance the world and the devices together, and transfer bytes when they are due.

    Close it (or use it as a context) to release the lines.
    """

    def __init__(
        self,
        world: World,
        emulators: Mapping[str, Emulator],
        directory: Path,
        send: Send = PtyLine.write,
        *,
        wired: Mapping[str, Line] | None = None,
    ) -> None:
        """Open a line for each emulator in a directory, a pty or a PWM output, or use that of its name in `wired`.

        `send` writes bytes to a pty: PtyLine.write in real time; in lockstep PtyLine.post, and the server then waits
        until the autopilot can read them.
        """
        self.world = world
        self._send = send
        wired = wired or {}
        self.ports = tuple(
            Port(directory / name, wired.get(name) or _open_line(directory / name, emulator), emulator)
            for name, emulator in emulators.items()
        )
        self._emulators = tuple(emulators.values())

    def __enter__(self) -> Self:
        """Return the board."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the lines."""
        self.close()

    def close(self) -> None:
        """Close all lines."""
        for port in self.ports:
            port.line.close()

    def paths(self) -> dict[str, str]:
        """Return the port of each line in the vehicle file, by its name."""
        return {port.path.name: port.address for port in self.ports}

    def port_at(self, address: str) -> Port:
        """Return the port with this address, as in the vehicle file; raise KeyError if there is none."""
        for port in self.ports:
            if port.address == address:
                return port
        raise KeyError(address)

    def next_output_s(self) -> float:
        """Return the time of the next output or event of any device."""
        return min(emulator.next_output_s() for emulator in self._emulators)

    def receive(self, port: Port, data: bytes) -> None:
        """Pass bytes of the autopilot to the device of a port at the present time."""
        port.emulator.receive(self.world.now_s, data)

    def advance(self, limit_s: float, read_deadline: Callable[[Port], float] = lambda _port: -math.inf) -> bool:
        """Advance to limit_s, or until the autopilot must read bytes; return True if it must read at once.

        `read_deadline` returns the time by which the autopilot must read the bytes that were delivered to a port.
        """
        deadline_s = math.inf
        due_s = [emulator.next_output_s() for emulator in self._emulators]
        while (next_s := min(due_s)) <= limit_s:
            if next_s >= deadline_s:
                return False
            self.world.advance_to(next_s)
            deadline_s = min(deadline_s, self._deliver(due_s, read_deadline))
            if deadline_s <= next_s:
                return True
        self.world.advance_to(limit_s)
        return False

    def _deliver(self, due_s: list[float], read_deadline: Callable[[Port], float]) -> float:
        """Transfer the output that is due and update due_s; return the earliest time by which it must be read."""
        now_s = self.world.now_s
        deadline_s = math.inf
        for index, port in enumerate(self.ports):
            if due_s[index] > now_s:
                continue
            data = port.emulator.take_output(now_s)
            due_s[index] = port.emulator.next_output_s()
            if data:
                if isinstance(port.line, PtyLine):
                    self._send(port.line, data)
                else:
                    port.line.write(data)
                deadline_s = min(deadline_s, read_deadline(port))
        return deadline_s


def _open_line(path: Path, emulator: Emulator) -> Line:
    """Open the line of a device at a path."""
    return PwmChannel(path) if isinstance(emulator, PwmEmulator) else PtyLine(path)
