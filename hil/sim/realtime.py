"""The real-time server: the same board, driven by the machine's clock."""

from __future__ import annotations

import select
import time

from hil.devices.pty_line import PtyLine
from hil.errors import HilError
from hil.sim.board import Board

FREE_INTERVAL_S = 1.0


class RealTimeServer:
    """Moves the board along with the wall clock and carries bytes as they come."""

    def __init__(self, board: Board) -> None:
        """Start the clock."""
        self._board = board
        self._ports = {port.line.fileno(): port for port in board.ports}
        self._free_s = 0.0
        self._start_s = time.monotonic() - board.world.now_s

    def now_s(self) -> float:
        """Seconds of the run gone by."""
        return time.monotonic() - self._start_s

    def serve(self, limit_s: float) -> float:
        """Do what is due, then wait for bytes or the next event, at most to limit_s.

        Returns how long nothing will happen if the autopilot stays as quiet as it was
        during the call; 0 when there was traffic. Events happen at their own moments even
        when this is called a little late, so the world is the one of a lockstep run with the same commands.
        """
        board = self._board
        if self.now_s() >= self._free_s:
            self._free_s = self.now_s() + FREE_INTERVAL_S
            for port in board.ports:
                if isinstance(port.line, PtyLine):
                    port.line.free()
        busy = self._catch_up(limit_s)
        self._miss_lines()
        wait_s = min(board.next_output_s(), limit_s) - self.now_s()
        for fd in select.select(self._ports, [], [], max(0.0, wait_s))[0]:
            busy = True
            self._catch_up(limit_s)
            port = self._ports[fd]
            if data := port.line.read():
                board.receive(port, data)
            self._miss_lines()
        busy = self._catch_up(limit_s) or busy
        return 0.0 if busy else board.next_output_s() - self.now_s()

    def _miss_lines(self) -> None:
        """Tell of a line that has gone, whether it was read or written then: HilError; the others go on after it."""
        for fd, port in self._ports.items():
            if not port.line.plugged:
                del self._ports[fd]
                raise HilError(f"the line of {port.path.name} has gone: is its adapter, or its link, still there?")

    def _catch_up(self, limit_s: float) -> bool:
        now_s = min(self.now_s(), limit_s)
        delivered = False
        while self._board.advance(now_s):
            delivered = True
        return delivered
