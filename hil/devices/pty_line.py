"""A serial port made of a pseudo-terminal, whose far end the board of ports holds.

The firmware opens the symlink as it would open a USB serial port. The kernel hands
bytes of a pty over in a work queue, some time after the write; for lockstep this
module waits until they are really there, on both sides.
"""

from __future__ import annotations

import fcntl
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable
from pathlib import Path

_INPUT_QUEUE = 4095  # bytes that Linux holds for a reader of a raw terminal (N_TTY_BUF_SIZE - 1)
_READ_SIZE = 65_536
_PATIENCE_S = 2.0
_YIELDS = 100  # how often to give way before sleeping
_NAP_S = 20e-6
_NOBODY = -1
_TIOCGEXCL = 0x80045440  # of <asm-generic/ioctls.h>; termios has it not
_NO_COUNT = bytes(4)  # room for the kernel's answer, a C int


class PtyLine:
    """A pty behind a symlink, which can be pulled out and plugged in again.

    The slave stays open here too, so that nothing hangs up while no firmware is
    there. Like a UART, the line drops the newest bytes when nobody reads them
    (`overrun_bytes`). `total_read` and `total_written` count since the last plug.
    """

    def __init__(self, link_path: Path) -> None:
        """Plug in at link_path; FileExistsError when something that is no symlink stands there."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        self._link = Path(link_path)
        self._master = _NOBODY
        self._slave = _NOBODY
        self._arrivals = select.poll()
        self._under_way = 0  # bytes that the firmware can read when those that were posted are there
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the port exists now."""
        return self._master != _NOBODY

    def fileno(self) -> int:
        """The descriptor to wait on for the firmware's bytes, or -1 while unplugged."""
        return self._master

    def plug(self) -> None:
        """Make a new pty behind the symlink, replacing a stale one; nothing when plugged."""
        if self.plugged:
            return
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(f"{self._link} stands where the port belongs; remove it")
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._arrivals = select.poll()
        self._arrivals.register(self._slave, select.POLLIN)
        fresh = self._link.with_name(f".{self._link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self._link)
        self.total_read = 0
        self.total_written = 0
        self.overrun_bytes = 0

    def unplug(self) -> None:
        """Pull the plug: the firmware's descriptor hangs up and the path vanishes; nothing when unplugged."""
        if not self.plugged:
            return
        self._link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = _NOBODY
        self._under_way = 0

    def free(self) -> None:
        """Lift the exclusive use of a firmware that was killed: the kernel keeps it, as the slave stays open here."""
        if not (self.plugged and any(fcntl.ioctl(self._slave, _TIOCGEXCL, _NO_COUNT))):
            return
        try:
            fcntl.flock(self._slave, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return  # it lives
        fcntl.ioctl(self._slave, termios.TIOCNXCL)
        fcntl.flock(self._slave, fcntl.LOCK_UN)

    def close(self) -> None:
        """End the port."""
        self.unplug()

    def read(self) -> bytes:
        """Return what the firmware has written and the kernel has handed over, without waiting."""
        return self._read(_READ_SIZE)

    def read_until_total(self, total: int, timeout_s: float = _PATIENCE_S) -> bytes:
        """Read on until `total_read` is total, or the time is up: then compare `total_read`."""
        if 0 < total - self.total_read <= _READ_SIZE:
            data = self._read(total - self.total_read)
            if self.total_read >= total:
                return data  # as nearly always in lockstep
            pieces = [data]
        else:
            pieces = []

        def complete() -> bool:
            if self.total_read < total:
                pieces.append(self._read(min(total - self.total_read, _READ_SIZE)))
            return self.total_read >= total or not self.plugged

        _wait(complete, timeout_s)
        return b"".join(pieces)

    def write(self, data: bytes) -> int:
        """Send to the firmware and return how many bytes went; the rest is counted as overrun, or lost unplugged."""
        return self._write(data, self.pending_at_slave())

    def _write(self, data: bytes, pending: int) -> int:
        if not self.plugged:
            return 0
        room = _INPUT_QUEUE - pending
        sent = 0
        while sent < min(len(data), room):
            try:
                sent += os.write(self._master, data[sent:room])
            except (BlockingIOError, InterruptedError):
                break
        self.total_written += sent
        self.overrun_bytes += len(data) - sent
        return sent

    def deliver(self, data: bytes, timeout_s: float = _PATIENCE_S) -> bool:
        """Write, and wait until all of it can be read by the firmware; False when it did not get there in time.

        For lockstep: the firmware must not read meanwhile, and what an earlier `write`
        left under way would be mistaken for these bytes, so deliver everything or nothing so.
        """
        return self.post(data) and self.arrived(timeout_s)

    def post(self, data: bytes) -> bool:
        """Write and go on; False when not all of it went. `arrived` is to be asked before the firmware may read."""
        pending = max(self.pending_at_slave(), self._under_way)
        sent = self._write(data, pending)
        self._under_way = pending + sent
        return sent == len(data)

    def arrived(self, timeout_s: float = _PATIENCE_S) -> bool:
        """Wait until all that was posted can be read by the firmware; False when it did not get there in time."""
        goal, self._under_way = self._under_way, 0
        if not goal:
            return True
        # Asked for bytes where there are none yet, Linux first ends what it has under way.
        self._arrivals.poll(0)
        return self.pending_at_slave() >= goal or _wait(lambda: self.pending_at_slave() >= goal, timeout_s)

    def pending_at_slave(self) -> int:
        """How many bytes wait to be read by the firmware (0 while unplugged)."""
        if not self.plugged:
            return 0
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, _NO_COUNT), sys.byteorder)

    def _read(self, size: int) -> bytes:
        if not self.plugged:
            return b""
        try:
            data = os.read(self._master, size)
        except (BlockingIOError, InterruptedError):
            return b""
        self.total_read += len(data)
        return data


def _wait(done: Callable[[], bool], timeout_s: float) -> bool:
    """Give way until done or the time is up: first by yielding, for the kernel needs microseconds, then by naps."""
    deadline_s = time.monotonic() + timeout_s
    turns = 0
    while not done():
        if time.monotonic() > deadline_s:
            return done()  # this process may have been stopped meanwhile
        turns += 1
        if turns < _YIELDS:
            os.sched_yield()
        else:
            time.sleep(_NAP_S)
    return True
