"""Serial ports with pyserial: exclusive, non-blocking, and opened again when they reappear."""

from __future__ import annotations

import errno
import fcntl
import math
import os
import select
import termios

import serial

from firmware_py.system.port_users import find_port_users

REOPEN_INTERVAL_S = 1.0
CHECK_INTERVAL_S = 1.0
MAX_SILENCE_S = 300.0
REPORT_INTERVAL_S = 600.0
MAX_READ_BYTES = 4096
MAX_UNSENT_BYTES = 4096
MAX_EMPTY_READS = 16  # then check whether the port still exists and is the same
_ZERO_COUNT = bytes(4)


class PortError(RuntimeError):
    """A port cannot be opened; the text names it and the remedy."""


class SerialPort:
    """A serial port as a ByteLine.

    Reading an empty terminal, or polling its descriptor, can block in the kernel until a kernel thread of normal
    priority has moved pending data, and a tick on a busy computer would wait for it. Therefore an epoll object waits
    for the port, and the port is read only if FIONREAD reports bytes.

    Other programs (getty, gpsd, brltty, ModemManager) may open the port and change its settings. TIOCEXCL excludes
    programs of users other than root, and pyserial's lock excludes programs that use such locks. Once a second, changed
    settings are restored.
    """

    def __init__(self, path: str, baud: int, *, silent_s: float = math.inf) -> None:
        """Store path and baud rate; `open` or `reopen` opens the port.

        A port without data for `silent_s` is closed and opened again. The time doubles with each repetition, up to
        MAX_SILENCE_S.
        """
        self._path = path
        self._baud = baud
        self._silent_s = self._max_silence_s = silent_s
        self._settings: list[object] = []
        self._has_new_data = True
        self._last_data_s = self._next_check_s = 0.0
        self._last_report_s = -math.inf
        self._port: serial.Serial | None = None
        self._fd = -1
        self._epoll: select.epoll | None = None
        self._openings = 0
        self._written = 0
        self._unsent = b""
        self._next_retry_s = 0.0
        self._empty_reads = 0
        # FIONREAD needs three times as long with an immutable buffer.
        self._pending_count = bytearray(4)

    @property
    def name(self) -> str:
        """The path of the port."""
        return self._path

    @property
    def baud(self) -> int:
        """The baud rate."""
        return self._baud

    @property
    def openings(self) -> int:
        """The number of times the port was opened."""
        return self._openings

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._fd >= 0

    @property
    def written(self) -> int:
        """Bytes written to the kernel since the port was last opened."""
        return self._written

    def fileno(self) -> int:
        """Return the descriptor that is readable when bytes are pending, or -1 while the port is closed."""
        return -1 if self._epoll is None else self._epoll.fileno()

    def open(self) -> None:
        """Open the port; raises PortError with the remedy."""
        try:
            self._open()
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise PortError(f"port {self._path}: {_explain_error(self._path, error)}") from None

    def _open(self) -> None:
        try:
            self._port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
            self._fd = self._port.fileno()
            self._epoll = select.epoll()
            self._epoll.register(self._fd, select.EPOLLIN)
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
            self._settings = termios.tcgetattr(self._fd)
        except BaseException:
            self.close()
            raise
        self._openings += 1
        self._written = 0
        self._unsent = b""
        self._has_new_data = True
        try:
            # Otherwise FTDI USB adapters delay received bytes by 16 ms.
            self._port.set_low_latency_mode(True)
        except (OSError, ValueError, NotImplementedError, AttributeError):
            pass  # not an FTDI adapter

    def reopen(self, now_s: float) -> str:
        """Once a second, open a closed port or check the settings of an open one; return a report or ""."""
        if self._fd >= 0:
            if now_s < self._next_check_s:
                return ""
            self._next_check_s = now_s + CHECK_INTERVAL_S
            return self._check_settings(now_s)
        if now_s >= self._next_retry_s:
            self._next_retry_s = now_s + REOPEN_INTERVAL_S
            self._try_to_open()
        return ""

    def _try_to_open(self) -> bool:
        try:
            self._open()
        except (serial.SerialException, OSError, ValueError, termios.error):
            return False
        return True

    def _check_settings(self, now_s: float) -> str:
        """Restore settings that another program has changed, and open a silent port again; return a report or ""."""
        try:
            is_changed = termios.tcgetattr(self._fd) != self._settings
            if is_changed:
                termios.tcsetattr(self._fd, termios.TCSANOW, self._settings)  # type: ignore[arg-type]
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
            is_restored = not is_changed or termios.tcgetattr(self._fd) == self._settings
        except (OSError, termios.error):
            self.close()
            return ""
        if self._has_new_data:
            self._has_new_data, self._last_data_s, self._max_silence_s = False, now_s, self._silent_s
        is_silent = now_s - self._last_data_s >= self._max_silence_s
        if is_silent:
            self._last_data_s, self._max_silence_s = now_s, min(2.0 * self._max_silence_s, MAX_SILENCE_S)
        if is_silent or not is_restored:
            self._reopen_silent()
        if not is_changed or now_s - self._last_report_s < REPORT_INTERVAL_S:
            return ""
        self._last_report_s = now_s
        users = find_port_users([self._path]).get(self._path)
        return f"Port {self._path}: changed by another program, restored" + (f"; open in {users}" if users else "")

    def _reopen_silent(self) -> None:
        """Close and open the port without counting an opening, because the device does not notice it."""
        openings, written = self._openings, self._written
        self.close()
        if self._try_to_open():
            self._openings, self._written, self._has_new_data = openings, written, False

    def read(self) -> bytes:
        """Return the pending bytes, at most MAX_READ_BYTES; close a lost port."""
        if self._fd < 0:
            return b""
        try:
            fcntl.ioctl(self._fd, termios.FIONREAD, self._pending_count)
            data = os.read(self._fd, MAX_READ_BYTES) if self._pending_count != _ZERO_COUNT else b""
        except BlockingIOError:
            return b""
        except OSError:
            self.close()
            return b""
        # A raw terminal returns no bytes when it is idle and also when its other end is closed.
        self._empty_reads = 0 if data else self._empty_reads + 1
        self._has_new_data = self._has_new_data or bool(data)
        if self._empty_reads >= MAX_EMPTY_READS:
            self._empty_reads = 0
            if self._is_hung_up():
                self.close()
        return data

    def _is_hung_up(self) -> bool:
        """Return whether the port is lost: its other end was closed, or its path now leads to another device."""
        try:
            termios.tcgetattr(self._fd)
            return os.stat(self._path).st_rdev != os.fstat(self._fd).st_rdev  # noqa: PTH116 - in the tick's path
        except (OSError, termios.error):
            return True

    def write(self, data: bytes) -> bool:
        """Write data to the kernel; return False if they are dropped.

        The part that the kernel does not accept is written before the next data.
        """
        if len(self._unsent) + len(data) > MAX_UNSENT_BYTES:
            # The line may be free again.
            self._unsent = self._write_now(self._unsent)
        if len(self._unsent) + len(data) > MAX_UNSENT_BYTES:
            return False
        self._unsent = self._write_now(self._unsent + data if self._unsent else data)
        return self._fd >= 0

    def _write_now(self, pending: bytes) -> bytes:
        """Write bytes to the kernel; return those that it does not accept, or close a lost port."""
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
                    # Otherwise the port stays exclusive while another program has it open.
                    fcntl.ioctl(self._fd, termios.TIOCNXCL)
                self._port.close()
            except (serial.SerialException, OSError):
                pass  # the port was unplugged
        if self._epoll is not None:
            self._epoll.close()
        self._port = self._epoll = None
        self._fd = -1


def _explain_error(path: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    text = str(error)
    if code in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY) or "lock" in text:
        users = find_port_users([path]).get(path, "fuser shows it to root")
        return f"in use by another program ({users}); end that one first"
    if code == errno.ENOENT or not os.path.exists(path):  # noqa: PTH110 - a path of /dev, as text
        return "no such port; plug the device in or correct the path in the vehicle file"
    if code in (errno.EACCES, errno.EPERM):
        return "permission denied; add the user to the dialout group"
    return f"cannot be opened as a serial port: {text.splitlines()[0][:80]}"
