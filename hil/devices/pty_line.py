"""A serial port made of a pseudo-terminal, with its far end in the harness.

The firmware opens the symlink like a USB serial port. The kernel transfers the bytes of a pty in a work queue, some
time after the write; for lockstep this module waits until they have arrived, on both sides.
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
_YIELDS = 100  # number of yields before sleeping
_NAP_S = 20e-6
_CLOSED = -1
_TIOCGEXCL = 0x80045440  # of <asm-generic/ioctls.h>; not in termios
_NO_COUNT = bytes(4)  # buffer for the kernel's reply, a C int


class PtyLine:
    """A pty behind a symlink, which can be unplugged and plugged in again.

    The slave stays open here too, so that nothing hangs up while no firmware runs. Like a UART, the line drops the
    newest bytes when they are not read (`overrun_bytes`). `total_read` and `total_written` count since the last plug.
    """

    def __init__(self, link_path: Path) -> None:
        """Plug in at link_path; FileExistsError if another file than a symlink exists there."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        self._link = Path(link_path)
        self._master = _CLOSED
        self._slave = _CLOSED
        self._arrivals = select.poll()
        self._posted = 0  # bytes for the firmware to read once all posted bytes have arrived
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the port exists now."""
        return self._master != _CLOSED

    def fileno(self) -> int:
        """Return the descriptor to wait on for the firmware's bytes, or -1 while unplugged."""
        return self._master

    def plug(self) -> None:
        """Create a pty behind the symlink, replacing a stale one; no effect when plugged."""
        if self.plugged:
            return
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(f"{self._link} exists and is not a symlink; remove it")
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
        """Unplug: the firmware's descriptor hangs up and the path vanishes; no effect when unplugged."""
        if not self.plugged:
            return
        self._link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = _CLOSED
        self._posted = 0

    def free(self) -> None:
        """Release the exclusive use by a killed firmware, which the kernel keeps because the slave is open here."""
        if not (self.plugged and any(fcntl.ioctl(self._slave, _TIOCGEXCL, _NO_COUNT))):
            return
        try:
            fcntl.flock(self._slave, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return  # the firmware is alive
        fcntl.ioctl(self._slave, termios.TIOCNXCL)
        fcntl.flock(self._slave, fcntl.LOCK_UN)

    def close(self) -> None:
        """Close the port."""
        self.unplug()

    def read(self) -> bytes:
        """Return the bytes of the firmware that have arrived, without waiting."""
        return self._read(_READ_SIZE)

    def read_until_total(self, total: int, timeout_s: float = _PATIENCE_S) -> bytes:
        """Read until `total_read` is `total`, or the timeout; the caller compares `total_read`."""
        if 0 < total - self.total_read <= _READ_SIZE:
            data = self._read(total - self.total_read)
            if self.total_read >= total:
                return data  # the usual case in lockstep
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
        """Send to the firmware and return the number of bytes sent; others count as overrun, or are lost unplugged."""
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
        """Write and wait until the firmware can read all bytes; return False after the timeout.

        For lockstep: the firmware must not read in the meantime, and bytes of an earlier `write` would be mistaken for
        these, so use `deliver` for all bytes or for none.
        """
        return self.post(data) and self.arrived(timeout_s)

    def post(self, data: bytes) -> bool:
        """Write without waiting; return False if not all was written. Call `arrived` before the firmware reads."""
        pending = max(self.pending_at_slave(), self._posted)
        sent = self._write(data, pending)
        self._posted = pending + sent
        return sent == len(data)

    def arrived(self, timeout_s: float = _PATIENCE_S) -> bool:
        """Wait until the firmware can read all posted bytes; return False after the timeout."""
        goal, self._posted = self._posted, 0
        if not goal:
            return True
        # A poll without pending bytes makes Linux finish its transfers first.
        self._arrivals.poll(0)
        return self.pending_at_slave() >= goal or _wait(lambda: self.pending_at_slave() >= goal, timeout_s)

    def pending_at_slave(self) -> int:
        """Return the number of bytes that the firmware has not read (0 while unplugged)."""
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
    """Wait until `done` or the timeout: first by yielding, because the kernel needs microseconds, then by sleeping."""
    deadline_s = time.monotonic() + timeout_s
    turns = 0
    while not done():
        if time.monotonic() > deadline_s:
            return done()  # this process may have been suspended
        turns += 1
        if turns < _YIELDS:
            os.sched_yield()
        else:
            time.sleep(_NAP_S)
    return True
