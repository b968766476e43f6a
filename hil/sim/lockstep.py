"""The lockstep server: the other end of the autopilot's clock in a run that is not in real time.

The autopilot connects to a Unix SOCK_SEQPACKET socket and says in JSON which serial lines
it has, by path and in order; it is told the time of the start. From then on each of its
waits is one packet (`<dQ` deadline and a bit for each line that is awaited, then `Q` for each
line: bytes written so far) and one packet in return (`<ddd` the new time, a step of its UTC,
and for how long to look for the next answer before it sleeps; then `<dQ` moment and line of
all that was said before): by then its bytes have reached the devices, the world has moved on
to the deadline or to the first bytes that are awaited, and those lie in its serial lines.
Nothing in this depends on how fast either side computes.

What is said on a line that the autopilot has never written on needs no answer, so the world
moves on behind it, up to the next bytes on that line, and the moment is told.
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
from hil.errors import HilError
from hil.sim.board import Board, Port
from hil.sim.own_cores import Turns
from hil.sim.pace import Pacer

PROTOCOL = 2
HELLO_BYTES = 65536
CONNECT_S = 20.0
STALL_S = 30.0
POLL_S = 0.1
NEW_TIME = struct.Struct("<ddd")
LINE_EVENT = struct.Struct("<dQ")


class LockstepError(HilError):
    """The autopilot does not keep to the protocol, has stopped answering, or is gone."""


class LockstepServer:
    """Serves one autopilot; a context that closes its sockets."""

    def __init__(
        self, path: Path, board: Board, pacer: Pacer, *, stall_s: float = STALL_S, cores: Sequence[int] = ()
    ) -> None:
        """Listen at path; `cores` are those that are kept for this process and the autopilot."""
        self._board = board
        self._pacer = pacer
        self._stall_s = stall_s
        self._turns = Turns(cores)
        self._ports: tuple[Port, ...] = ()
        self._packet = NEW_TIME
        self._lines: dict[Path, int] = {}  # their numbers
        self._awaited = 0  # a bit for each line whose bytes end the wait
        self._unheard = 0  # lines with bytes of which it is not known that they have been read
        self._said: list[tuple[float, int]] = []  # in this wait, when and on which line, which did not end it
        self._received: list[int] = []
        self._before: list[int] = []  # what earlier processes wrote on each line
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

    def accept(self, alive: Callable[[], bool], utc_s: float) -> None:
        """Wait for the autopilot and greet it; LockstepError when it dies first, is late, or has other lines.

        Called again for one that has left in order to start anew.
        """
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        end_s = time.monotonic() + CONNECT_S
        self._listener.settimeout(POLL_S)
        while self._connection is None:
            try:
                self._connection = self._listener.accept()[0]
            except TimeoutError:
                if not alive():
                    raise LockstepError("the autopilot ended before it connected") from None
                if time.monotonic() > end_s:
                    raise LockstepError(f"the autopilot did not connect within {CONNECT_S:g} s") from None
        # The kernel's own time limit: Python's costs a call more each time.
        limit = struct.pack("ll", *divmod(round(self._stall_s * 1e6), 1_000_000))
        self._connection.settimeout(None)
        self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        self._turns.begin(self._connection)
        for port in self._ports:
            # What an earlier process wrote behind its last wait.
            self._board.receive(port, port.line.read())
        self._ports = self._lines_of(self._receive())
        self._lines = {port.path: number for number, port in enumerate(self._ports)}
        self._unheard = 0
        self._received = [0] * len(self._ports)
        self._before = [port.line.total_read for port in self._ports]
        self._packet = struct.Struct(f"<d{1 + len(self._ports)}Q")
        self._send(json.dumps({"start_s": self._board.world.now_s, "utc_s": utc_s}).encode())

    def step_utc(self, seconds: float) -> None:
        """Step the autopilot's UTC with the next answer, as somebody who sets the computer's clock."""
        self._utc_step_s += seconds

    def stall(self, seconds: float) -> None:
        """Let the next wait last this much longer than it was asked to, as a computer that is busy elsewhere."""
        self._stall_until_s = self._board.world.now_s + seconds

    def serve(self, limit_s: float = math.inf, *, paced: bool = True) -> bool:
        """Answer one wait, with the world at limit_s at the latest; False when the autopilot has closed the socket."""
        packet = self._receive()
        if not packet:
            return False
        if len(packet) != self._packet.size:
            raise LockstepError(f"a packet of {len(packet)} bytes from the autopilot; expected {self._packet.size}")
        deadline_s, self._awaited, *written = self._packet.unpack(packet)
        if not math.isfinite(deadline_s):
            raise LockstepError("the autopilot waits for a deadline that is not a number")
        self._take_in(written)
        self._said.clear()
        if self._board.world.now_s < self._stall_until_s:
            self._awaited = 0
            self._board.advance(self._stall_until_s, self._patience)
        elif not self._waiting():
            self._board.advance(min(deadline_s, limit_s), self._patience)
        for port in self._board.ports:
            if isinstance(port.line, PtyLine) and not port.line.arrived():
                raise LockstepError(f"bytes for the autopilot have not come through to {port.path.name}")
        now_s = self._board.world.now_s
        if paced:
            self._pacer.wait(now_s)
        step_s, self._utc_step_s = self._utc_step_s, 0.0
        head = NEW_TIME.pack(now_s, step_s, self._turns.look_s())
        self._send(head + b"".join(LINE_EVENT.pack(*said) for said in self._said))
        return True

    def _patience(self, port: Port) -> float:
        """Return before which moment the autopilot must look at the bytes that have just been put into a line."""
        number = self._lines.get(port.path)
        if number is None:
            return math.inf
        self._unheard |= 1 << number
        if not self._awaited >> number & 1:
            return math.inf
        if self._received[number]:
            return -math.inf
        self._said.append((self._board.world.now_s, number))
        return port.emulator.next_output_s()

    def _waiting(self) -> bool:
        """Whether bytes lie in a line that is awaited now: they came when it was not, or when she left them there."""
        waiting = False
        for number, port in enumerate(self._ports):
            line = 1 << number
            if not self._unheard & self._awaited & line:
                continue
            if isinstance(port.line, PtyLine) and port.line.pending_at_slave() > 0:
                waiting = True
            else:
                self._unheard ^= line
        return waiting

    def _take_in(self, written: list[int]) -> None:
        for index, total in enumerate(written):
            port, line = self._ports[index], self._ports[index].line
            if not (isinstance(line, PtyLine) and line.plugged):
                self._received[index] = total  # what was under way is lost with the cable
                continue
            if total < self._received[index]:  # the port has been opened anew behind a new plug
                self._received[index] = self._before[index] = 0
            if total > self._received[index]:
                wanted = self._before[index] + total
                data = line.read_until_total(wanted)
                if line.total_read < wanted:
                    raise LockstepError(f"bytes that the autopilot wrote to {port.path.name} have not come through")
                self._received[index] = total
                self._board.receive(port, data)

    def _lines_of(self, hello: bytes) -> tuple[Port, ...]:
        try:
            content: Any = json.loads(hello)
            protocol, lines = content["protocol"], [str(path) for path in content["lines"]]
        except (ValueError, KeyError, TypeError):
            raise LockstepError(f"the autopilot greets with {hello[:60]!r}; expected protocol and lines") from None
        if protocol != PROTOCOL:
            raise LockstepError(f"the autopilot speaks lockstep protocol {protocol}; this is {PROTOCOL}")
        try:
            return tuple(self._board.port_at(path) for path in lines)
        except KeyError as error:
            raise LockstepError(f"the autopilot has opened {error.args[0]}, which is no line of this board") from None

    def _receive(self) -> bytes:
        if self._connection is None:
            return b""
        self._turns.look()
        try:
            return self._connection.recv(HELLO_BYTES)
        except BlockingIOError:
            raise LockstepError(f"nothing from the autopilot for {self._stall_s:g} s: it hangs") from None
        except OSError:
            return b""

    def _send(self, packet: bytes) -> None:
        if self._connection is None:
            return
        try:
            self._connection.sendall(packet)
        except OSError:
            # It has ended in between; the next _receive says so.
            self._connection.close()
            self._connection = None
