"""The lockstep server, which is the clock of the autopilot in a run that is not in real time.

The autopilot connects to a Unix SOCK_SEQPACKET socket and sends its serial lines in JSON, by path and in order; the
server replies with the start time. Then each wait of the autopilot is one packet (`<dQ`: deadline and a bit for each
awaited line; then `Q` for each line: bytes written so far) and one reply (`<ddd`: new time, a step of UTC, and how
long to poll for the next reply before sleeping; then `<dQ`: time and line of each earlier output). When the reply is
sent, the autopilot's bytes have reached the devices, the world has advanced to the deadline or to the first awaited
bytes, and those are in the serial lines. Nothing in this depends on the speed of either side.

Output on a line on which the autopilot has never written needs no immediate response. The world then advances up to the
next output on that line, and the reply states the time of the first.
"""

from __future__ import annotations

import json
import math
import socket
import struct
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hil.devices.pty_line import PtyLine
from hil.devices.pwm_channel import PwmChannel
from hil.errors import HilError
from hil.sim.board import Board, Port
from hil.sim.pace import Pacer
from hil.sim.reserved_cores import TurnTaking

PROTOCOL = 2
HELLO_BYTES = 65536
CONNECT_TIMEOUT_S = 20.0
STALL_TIMEOUT_S = 30.0
POLL_S = 0.1
NEW_TIME = struct.Struct("<ddd")
OUTPUT = struct.Struct("<dQ")


class LockstepError(HilError):
    """The autopilot violates the protocol, does not reply, or has ended."""


class LockstepServer:
    """Serve one autopilot; a context that closes its sockets."""

    def __init__(
        self, path: Path, board: Board, pacer: Pacer, *, stall_s: float = STALL_TIMEOUT_S, cores: Sequence[int] = ()
    ) -> None:
        """Listen at path; `cores` are those reserved for this process and the autopilot."""
        self._board = board
        self._pacer = pacer
        self._stall_s = stall_s
        self._turn_taking = TurnTaking(cores)
        self._ports: tuple[Port, ...] = ()
        self._packet = NEW_TIME
        self._lines: dict[Path, int] = {}  # number of each line
        self._awaited = 0  # a bit for each line whose bytes end the wait
        self._unread = 0  # a bit for each line with bytes that the autopilot may not have read
        self._outputs: list[tuple[float, int]] = []  # time and line of the outputs that did not end this wait
        self._received_totals: list[int] = []
        self._earlier_bytes: list[int] = []  # bytes that earlier processes wrote on each line
        self._utc_step_s = 0.0
        self._stall_until_s = -math.inf
        self._connection: socket.socket | None = None
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._listener.bind(str(path))
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise LockstepError(f"lockstep socket {path}: {error.strerror}") from None

    def __enter__(self) -> Self:
        """Return the server."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the sockets, which ends the autopilot's run."""
        self.close()

    def close(self) -> None:
        """Close the sockets, which ends the autopilot's run."""
        self._listener.close()
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def accept(self, is_alive: Callable[[], bool], utc_s: float) -> None:
        """Wait for the autopilot and send the start time; raise LockstepError if it ends, is late or has other lines.

        This is called again for an autopilot that restarts.
        """
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        deadline_s = time.monotonic() + CONNECT_TIMEOUT_S
        self._listener.settimeout(POLL_S)
        while self._connection is None:
            try:
                self._connection = self._listener.accept()[0]
            except TimeoutError:
                if not is_alive():
                    raise LockstepError("the autopilot ended before it connected") from None
                if time.monotonic() > deadline_s:
                    raise LockstepError(f"the autopilot did not connect within {CONNECT_TIMEOUT_S:g} s") from None
        # The timeout of the kernel; that of Python takes an additional system call each time.
        timeout = struct.pack("ll", *divmod(round(self._stall_s * 1e6), 1_000_000))
        self._connection.settimeout(None)
        self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        self._turn_taking.begin(self._connection)
        for port in self._ports:
            # Bytes that an earlier process wrote after its last wait.
            self._board.receive(port, port.line.read())
        self._ports = self._ports_of(self._receive())
        self._lines = {port.path: number for number, port in enumerate(self._ports)}
        self._unread = 0
        self._received_totals = [0] * len(self._ports)
        self._earlier_bytes = [port.line.total_read for port in self._ports]
        self._packet = struct.Struct(f"<d{1 + len(self._ports)}Q")
        self._send(json.dumps({"start_s": self._board.world.now_s, "utc_s": utc_s}).encode())

    def step_utc(self, seconds: float) -> None:
        """Step the UTC of the autopilot with the next reply, as if the clock of its computer were set."""
        self._utc_step_s += seconds

    def stall(self, seconds: float) -> None:
        """Prolong the next wait, as a busy computer does."""
        self._stall_until_s = self._board.world.now_s + seconds

    def serve(self, limit_s: float = math.inf, *, paced: bool = True) -> bool:
        """Reply to one wait, at limit_s at the latest; return False if the autopilot has closed the socket."""
        packet = self._receive()
        if not packet:
            return False
        if len(packet) != self._packet.size:
            raise LockstepError(f"a packet of {len(packet)} bytes from the autopilot; expected {self._packet.size}")
        deadline_s, self._awaited, *written = self._packet.unpack(packet)
        if not math.isfinite(deadline_s):
            raise LockstepError("the autopilot waits for a deadline that is not a number")
        self._receive_bytes(written)
        self._outputs.clear()
        if self._board.world.now_s < self._stall_until_s:
            self._awaited = 0
            self._board.advance(self._stall_until_s, self._read_deadline)
        elif not self._has_unread():
            self._board.advance(min(deadline_s, limit_s), self._read_deadline)
        for port in self._board.ports:
            if isinstance(port.line, PtyLine) and not port.line.wait_for_posted():
                raise LockstepError(f"bytes for the autopilot have not arrived at {port.path.name}")
        now_s = self._board.world.now_s
        if paced:
            self._pacer.wait(now_s)
        step_s, self._utc_step_s = self._utc_step_s, 0.0
        header = NEW_TIME.pack(now_s, step_s, self._turn_taking.poll_time_s())
        self._send(header + b"".join(OUTPUT.pack(*output) for output in self._outputs))
        return True

    def _read_deadline(self, port: Port) -> float:
        """Return the time by which the autopilot must read the bytes that were just written to a line."""
        number = self._lines.get(port.path)
        if number is None:
            return math.inf
        self._unread |= 1 << number
        if not self._awaited >> number & 1:
            return math.inf
        if self._received_totals[number]:
            return -math.inf
        self._outputs.append((self._board.world.now_s, number))
        return port.emulator.next_output_s()

    def _has_unread(self) -> bool:
        """Return whether an awaited line contains earlier bytes that the autopilot has not read."""
        has_unread = False
        for number, port in enumerate(self._ports):
            line = 1 << number
            if not self._unread & self._awaited & line:
                continue
            if isinstance(port.line, PtyLine) and port.line.pending_at_slave() > 0:
                has_unread = True
            else:
                self._unread ^= line
        return has_unread

    def _receive_bytes(self, written: list[int]) -> None:
        for index, total in enumerate(written):
            port, line = self._ports[index], self._ports[index].line
            if not (isinstance(line, PtyLine | PwmChannel) and line.is_plugged):
                self._received_totals[index] = total  # bytes in transit are lost with the cable
                continue
            if total < self._received_totals[index]:  # the port was reopened after the cable was plugged in again
                self._received_totals[index] = self._earlier_bytes[index] = 0
            if total > self._received_totals[index]:
                total_written = self._earlier_bytes[index] + total
                data = line.read_until_total(total_written)
                if line.total_read < total_written:
                    raise LockstepError(f"bytes that the autopilot wrote to {port.path.name} did not arrive")
                self._received_totals[index] = total
                self._board.receive(port, data)

    def _ports_of(self, hello: bytes) -> tuple[Port, ...]:
        try:
            content: Any = json.loads(hello)
            protocol, lines = content["protocol"], [str(path) for path in content["lines"]]
        except (ValueError, KeyError, TypeError):
            raise LockstepError(f"the first packet is {hello[:60]!r}; expected protocol and lines") from None
        if protocol != PROTOCOL:
            raise LockstepError(f"the autopilot uses lockstep protocol {protocol}; expected {PROTOCOL}")
        try:
            return tuple(self._board.port_at(path) for path in lines)
        except KeyError as error:
            raise LockstepError(f"the autopilot has opened {error.args[0]}, not a line of this board") from None

    def _receive(self) -> bytes:
        if self._connection is None:
            return b""
        self._turn_taking.poll()
        try:
            return self._connection.recv(HELLO_BYTES)
        except BlockingIOError:
            raise LockstepError(f"no packet from the autopilot for {self._stall_s:g} s: it hangs") from None
        except OSError:
            return b""

    def _send(self, packet: bytes) -> None:
        if self._connection is None:
            return
        try:
            self._connection.sendall(packet)
        except OSError:
            # The autopilot has ended in the meantime; the next _receive reports it.
            self._connection.close()
            self._connection = None
