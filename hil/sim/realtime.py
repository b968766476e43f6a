"""The real-time server, which advances the board with the clock of the computer."""

from __future__ import annotations

import select
import time

from hil.devices.pty_line import PtyLine
from hil.errors import HilError
from hil.sim.board import Board

RELEASE_INTERVAL_S = 1.0


class RealTimeServer:
    """Advance the board with the wall clock and transfer bytes as they arrive."""

    def __init__(self, board: Board) -> None:
        """Start the clock."""
        self._board = board
        self._ports = {port.line.fileno(): port for port in board.ports}
        self._release_s = 0.0
        self._start_s = time.monotonic() - board.world.now_s

    def now_s(self) -> float:
        """Return the seconds since the start of the run."""
        return time.monotonic() - self._start_s

    def serve(self, limit_s: float) -> float:
        """Process the events that are due, then wait for bytes or the next event, at most until limit_s.

        Return the time until the next event, or 0 if there was traffic. Events have their exact times even if this is
        called late, so the world equals that of a lockstep run with the same commands.
        """
        board = self._board
        if self.now_s() >= self._release_s:
            # A killed autopilot leaves its exclusive use of a pseudo terminal behind; the next one could not open it.
            self._release_s = self.now_s() + RELEASE_INTERVAL_S
            for port in board.ports:
                if isinstance(port.line, PtyLine):
                    port.line.release_exclusive_use()
        has_traffic = self._catch_up(limit_s)
        self._check_lines()
        wait_s = min(board.next_output_s(), limit_s) - self.now_s()
        for fd in select.select(self._ports, [], [], max(0.0, wait_s))[0]:
            has_traffic = True
            self._catch_up(limit_s)
            port = self._ports[fd]
            if data := port.line.read():
                board.receive(port, data)
            self._check_lines()
        has_traffic = self._catch_up(limit_s) or has_traffic
        return 0.0 if has_traffic else board.next_output_s() - self.now_s()

    def _check_lines(self) -> None:
        """Raise HilError for a line that is unplugged; the other lines remain usable."""
        for fd, port in self._ports.items():
            if not port.line.is_plugged:
                del self._ports[fd]
                raise HilError(f"the line of {port.path.name} is gone: check its adapter or its link")

    def _catch_up(self, limit_s: float) -> bool:
        now_s = min(self.now_s(), limit_s)
        has_delivered = False
        while self._board.advance(now_s):
            has_delivered = True
        return has_delivered
