"""A serial port that is a pseudo-terminal (pty), with its far end in the harness.

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

from hil.errors import UsageError

_MAX_INPUT_BYTES = 4095  # that Linux buffers for a reader of a raw terminal (N_TTY_BUF_SIZE - 1)
_READ_SIZE = 65_536
_TIMEOUT_S = 2.0
_MAX_YIELDS = 100  # number of yields before sleeping
_SLEEP_S = 20e-6
_CLOSED = -1
_TIOCGEXCL = 0x80045440  # from <asm-generic/ioctls.h>; termios does not define it
_INT_BUFFER = bytes(4)  # buffer for the kernel's reply, a C int


class PtyLine:
    """A pty behind a symlink, which can be unplugged and plugged in again.

    The slave stays open here too, so that the port does not hang up while no firmware runs. Like a UART, the line drops
    the newest bytes if they are not read (`overrun_bytes`). `total_read` and `total_written` count since the last plug.
    """

    def __init__(self, link_path: Path) -> None:
        """Plug in at link_path; errors as of plug()."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        self._link = Path(link_path)
        self._master = _CLOSED
        self._slave = _CLOSED
        self._arrivals = select.poll()
        self._pending_total = 0  # bytes for the firmware to read once all posted bytes have arrived
        self.plug()

    @property
    def is_plugged(self) -> bool:
        """True while the port exists."""
        return self._master != _CLOSED

    def fileno(self) -> int:
        """Return the descriptor to wait on for the firmware's bytes, or -1 while unplugged."""
        return self._master

    def plug(self) -> None:
        """Create a pty behind the symlink, replacing a stale one; no effect if it is plugged.

        Raise FileExistsError if another file exists there, UsageError if the system has no pty.
        """
        if self.is_plugged:
            return
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(f"{self._link} exists and is not a symlink; remove it")
        try:
            self._master, self._slave = os.openpty()
        except OSError as error:
            text = f"no pseudo-terminal: {error.strerror}; mount /dev/pts, or end programs that hold pseudo-terminals"
            raise UsageError(text) from error
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._arrivals = select.poll()
        self._arrivals.register(self._slave, select.POLLIN)
        new_link = self._link.with_name(f".{self._link.name}.{os.getpid()}")
        new_link.unlink(missing_ok=True)
        new_link.symlink_to(os.ttyname(self._slave))
        new_link.replace(self._link)
        self.total_read = 0
        self.total_written = 0
        self.overrun_bytes = 0

    def unplug(self) -> None:
        """Unplug: the firmware's descriptor hangs up and the path vanishes; no effect if it is unplugged."""
        if not self.is_plugged:
            return
        self._link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = _CLOSED
        self._pending_total = 0

    def release_exclusive_use(self) -> None:
        """Release the exclusive use by a killed firmware; the kernel keeps it because the slave is open here."""
        if not (self.is_plugged and any(fcntl.ioctl(self._slave, _TIOCGEXCL, _INT_BUFFER))):
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

    def read_until_total(self, total: int, timeout_s: float = _TIMEOUT_S) -> bytes:
        """Read until `total_read` is `total`, or the timeout; the caller compares `total_read`."""
        if 0 < total - self.total_read <= _READ_SIZE:
            data = self._read(total - self.total_read)
            if self.total_read >= total:
                return data  # the usual case in lockstep
            pieces = [data]
        else:
            pieces = []

        def is_complete() -> bool:
            if self.total_read < total:
                pieces.append(self._read(min(total - self.total_read, _READ_SIZE)))
            return self.total_read >= total or not self.is_plugged

        _wait_until(is_complete, timeout_s)
        return b"".join(pieces)

    def write(self, data: bytes) -> int:
        """Send to the firmware and return the number of bytes sent; the others count as overrun (0 while unplugged)."""
        return self._write(data, self.pending_at_slave())

    def _write(self, data: bytes, pending: int) -> int:
        if not self.is_plugged:
            return 0
        room = _MAX_INPUT_BYTES - pending
        sent = 0
        while sent < min(len(data), room):
            try:
                sent += os.write(self._master, data[sent:room])
            except (BlockingIOError, InterruptedError):
                break
        self.total_written += sent
        self.overrun_bytes += len(data) - sent
        return sent

    def deliver(self, data: bytes, timeout_s: float = _TIMEOUT_S) -> bool:
        """Write and wait until the firmware can read all bytes; return False if the timeout expires.

        For lockstep: the firmware must not read in the meantime, and bytes of an earlier `write` would be mistaken for
        these, so use `deliver` for all bytes or for none.
        """
        return self.post(data) and self.wait_for_posted(timeout_s)

    def post(self, data: bytes) -> bool:
        """Write without waiting; return False if bytes were dropped. `wait_for_posted` waits for the bytes."""
        pending = max(self.pending_at_slave(), self._pending_total)
        sent = self._write(data, pending)
        self._pending_total = pending + sent
        return sent == len(data)

    def wait_for_posted(self, timeout_s: float = _TIMEOUT_S) -> bool:
        """Wait until the firmware can read all posted bytes; return False if the timeout expires."""
        total, self._pending_total = self._pending_total, 0
        if not total:
            return True
        # A poll without pending bytes makes Linux finish its transfers first.
        self._arrivals.poll(0)
        return self.pending_at_slave() >= total or _wait_until(lambda: self.pending_at_slave() >= total, timeout_s)

    def pending_at_slave(self) -> int:
        """Return the number of bytes that the firmware has not read (0 while unplugged)."""
        if not self.is_plugged:
            return 0
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, _INT_BUFFER), sys.byteorder)

    def _read(self, size: int) -> bytes:
        if not self.is_plugged:
            return b""
        try:
            data = os.read(self._master, size)
        except (BlockingIOError, InterruptedError):
            return b""
        self.total_read += len(data)
        return data


def _wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Wait for a condition or the timeout; yield first, because the kernel needs microseconds, then sleep."""
    deadline_s = time.monotonic() + timeout_s
    attempts = 0
    while not condition():
        if time.monotonic() > deadline_s:
            return condition()  # this process may have been suspended
        attempts += 1
        if attempts < _MAX_YIELDS:
            os.sched_yield()
        else:
            time.sleep(_SLEEP_S)
    return True
