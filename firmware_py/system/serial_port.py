"""Serial ports through pyserial: exclusive, non-blocking, taken up again when they come back."""

from __future__ import annotations

import errno
import fcntl
import math
import os
import select
import termios

import serial

from firmware_py.system.port_users import port_users

REOPEN_INTERVAL_S = 1.0
LOOK_INTERVAL_S = 1.0
MOST_PATIENCE_S = 300.0
TELL_AGAIN_S = 600.0
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

    Other programs open serial ports, too, and set them as they like (getty, gpsd, brltty, ModemManager). TIOCEXCL keeps
    out those that are not root's and come later; the lock of pyserial keeps out those that ask for it. Once a second
    the settings are compared with what they were when the port was opened, and set again.
    """

    def __init__(self, path: str, baud: int, *, silent_s: float = math.inf) -> None:
        """Remember path and baud rate; `open` or `reopen` opens the port.

        A port without a byte for `silent_s` is closed and opened again, then after twice that time, and so on.
        """
        self._path = path
        self._baud = baud
        self._silent_s = self._patience_s = silent_s
        self._settings: list[object] = []
        self._heard = True
        self._heard_s = self._look_s = 0.0
        self._told_s = -math.inf
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
            self._open()
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise PortError(f"port {self._path}: {_reason(self._path, error)}") from None

    def _open(self) -> None:
        try:
            self._port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = self._port.fileno()
            self._arrivals = select.epoll()
            self._arrivals.register(self._fd, select.EPOLLIN)
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
            self._settings = termios.tcgetattr(self._fd)
        except BaseException:
            self.close()
            raise
        self._openings += 1
        self._written = 0
        self._unsent = b""
        self._heard = True
        try:
            # USB adapters of the FTDI kind otherwise sit on received bytes for 16 ms.
            self._port.set_low_latency_mode(True)
        except (OSError, ValueError, NotImplementedError, AttributeError):
            pass  # not such an adapter

    def reopen(self, now_s: float) -> str:
        """Once a second open a port that is away, or check the settings of an open one; return a report or ""."""
        if self._fd >= 0:
            if now_s < self._look_s:
                return ""
            self._look_s = now_s + LOOK_INTERVAL_S
            return self._look_after(now_s)
        if now_s >= self._retry_s:
            self._retry_s = now_s + REOPEN_INTERVAL_S
            self._try_to_open()
        return ""

    def _try_to_open(self) -> bool:
        try:
            self._open()
        except (serial.SerialException, OSError, ValueError, termios.error):
            return False
        return True

    def _look_after(self, now_s: float) -> str:
        """Set what another program has changed, and open a silent port again."""
        try:
            changed = termios.tcgetattr(self._fd) != self._settings
            if changed:
                termios.tcsetattr(self._fd, termios.TCSANOW, self._settings)  # type: ignore[arg-type]
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
            restored = not changed or termios.tcgetattr(self._fd) == self._settings
        except (OSError, termios.error):
            self.close()
            return ""
        if self._heard:
            self._heard, self._heard_s, self._patience_s = False, now_s, self._silent_s
        silent = now_s - self._heard_s >= self._patience_s
        if silent:
            self._heard_s, self._patience_s = now_s, min(2.0 * self._patience_s, MOST_PATIENCE_S)
        if silent or not restored:
            self._renew()
        if not changed or now_s - self._told_s < TELL_AGAIN_S:
            return ""
        self._told_s = now_s
        users = port_users([self._path]).get(self._path)
        return f"Port {self._path}: changed by another program, restored" + (f"; open in {users}" if users else "")

    def _renew(self) -> None:
        """Close and open the port; to a driver it is the same line, as its device has seen nothing of this."""
        openings, written = self._openings, self._written
        self.close()
        if self._try_to_open():
            self._openings, self._written, self._heard = openings, written, False

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
        self._heard = self._heard or bool(data)
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
                if self._fd >= 0:
                    fcntl.ioctl(self._fd, termios.TIOCNXCL)  # the kernel keeps it while another program has it open
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
        users = port_users([path]).get(path, "fuser shows it to root")
        return f"in use by another program ({users}); end that one first"
    if code == errno.ENOENT or not os.path.exists(path):  # noqa: PTH110 - a path of /dev, as text
        return "no such port; plug the device in or correct the path in the vehicle file"
    if code in (errno.EACCES, errno.EPERM):
        return "permission denied; add the user to the dialout group"
    return f"cannot be opened as a serial port: {text.splitlines()[0][:80]}"
