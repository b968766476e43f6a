"""Serial ports through pyserial: exclusive, non-blocking, taken up again when they come back."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import termios

import serial

REOPEN_INTERVAL_S = 1.0
READ_LIMIT = 4096
UNSENT_LIMIT = 4096
# So many reads without a byte, and the port is looked at: is it still there, and ours?
EMPTY_READS_LIMIT = 16
_NOTHING = bytes(4)


class PortError(RuntimeError):
    """A port cannot be opened; the text names it and the remedy."""


class SerialPort:
    """A serial port as a ByteLine.

    Who reads a terminal that has nothing, or waits for it by its own descriptor, is held inside the kernel until an
    ordinary thread there has moved what is under way, and on a busy computer that one waits its turn: a tick would
    wait with it, whatever its priority. So the port is awaited by an epoll, which looks at the terminal only when it
    has called, and is read only when it says that there are bytes.
    """

    def __init__(self, path: str, baud: int) -> None:
        """Remember path and baud rate; `open` or `reopen` opens the port."""
        self._path = path
        self._baud = baud
        self._port: serial.Serial | None = None
        self._fd = -1
        self._arrivals: select.epoll | None = None
        self._openings = 0
        self._written = 0
        self._unsent = b""
        self._retry_s = 0.0
        self._empty_reads = 0
        # As the kernel gives it. Python tries to write it: to find that it cannot costs three times what it asks.
        self._count = bytearray(4)

    @property
    def name(self) -> str:
        """The path of the port."""
        return self._path

    @property
    def baud(self) -> int:
        """Bits a second."""
        return self._baud

    @property
    def openings(self) -> int:
        """How often the port has been opened."""
        return self._openings

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._fd >= 0

    @property
    def written(self) -> int:
        """Bytes handed to the kernel since the port was last opened."""
        return self._written

    def fileno(self) -> int:
        """The descriptor that is readable when bytes are there, or -1 while the port is away."""
        return -1 if self._arrivals is None else self._arrivals.fileno()

    def open(self) -> None:
        """Open the port, or raise PortError."""
        try:
            self._port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = self._port.fileno()
            self._arrivals = select.epoll()
            self._arrivals.register(self._fd, select.EPOLLIN)
        except (serial.SerialException, OSError, ValueError) as error:
            self.close()
            raise PortError(f"port {self._path}: {_reason(self._path, error)}") from None
        self._openings += 1
        self._written = 0
        self._unsent = b""
        try:
            # USB adapters of the FTDI kind otherwise sit on received bytes for 16 ms.
            self._port.set_low_latency_mode(True)
        except (OSError, ValueError, NotImplementedError, AttributeError):
            pass  # not such an adapter

    def reopen(self, now_s: float) -> None:
        """Try once a second to open a port that is away."""
        if self._fd >= 0 or now_s < self._retry_s:
            return
        self._retry_s = now_s + REOPEN_INTERVAL_S
        try:
            self.open()
        except PortError:
            return

    def read(self) -> bytes:
        """All bytes that are there, at most 4096; a port that has gone is closed."""
        if self._fd < 0:
            return b""
        try:
            fcntl.ioctl(self._fd, termios.FIONREAD, self._count)
            data = os.read(self._fd, READ_LIMIT) if self._count != _NOTHING else b""
        except BlockingIOError:
            return b""
        except OSError:
            self.close()
            return b""
        # A raw terminal reads nothing both when it is idle and when its other end is gone.
        self._empty_reads = 0 if data else self._empty_reads + 1
        if self._empty_reads >= EMPTY_READS_LIMIT:
            self._empty_reads = 0
            if self._hung_up():
                self.close()
        return data

    def _hung_up(self) -> bool:
        """Say whether the other end is gone; when it is back already the path is there, and is another's."""
        try:
            termios.tcgetattr(self._fd)
            return os.stat(self._path).st_rdev != os.fstat(self._fd).st_rdev  # noqa: PTH116 - in the tick's path
        except (OSError, termios.error):
            return True

    def write(self, data: bytes) -> bool:
        """Hand data to the kernel; what does not fit now goes before the next write."""
        if len(self._unsent) + len(data) > UNSENT_LIMIT:
            # A line that was jammed may have come free: else what waits would shut it for ever.
            self._unsent = self._push(self._unsent)
        if self._fd < 0 or len(self._unsent) + len(data) > UNSENT_LIMIT:
            return False
        self._unsent = self._push(self._unsent + data if self._unsent else data)
        return self._fd >= 0

    def _push(self, pending: bytes) -> bytes:
        """Hand bytes to the kernel and return those that do not fit; a port that has gone is closed."""
        if self._fd < 0:
            return b""
        try:
            count = os.write(self._fd, pending)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                self.close()
            count = 0
        self._written += count
        return pending[count:]

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            try:
                self._port.close()
            except (serial.SerialException, OSError):
                pass  # a port that has vanished cannot be closed in good order
        if self._arrivals is not None:
            self._arrivals.close()
        self._port = self._arrivals = None
        self._fd = -1


def _reason(path: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    text = str(error)
    if code in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY) or "lock" in text:
        return "in use by another program; end that one first (fuser shows it)"
    if code == errno.ENOENT or not os.path.exists(path):  # noqa: PTH110 - a path of /dev, as text
        return "no such port; plug the device in or correct the path in the vehicle file"
    if code in (errno.EACCES, errno.EPERM):
        return "permission denied; add the user to the dialout group"
    return f"cannot be opened as a serial port: {text.splitlines()[0][:80]}"
