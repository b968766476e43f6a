"""A serial adapter of this computer, with the float computer at its other end."""

from __future__ import annotations

import os
import select

import serial

_READ_SIZE = 65_536


class SerialLineError(OSError):
    """The adapter cannot be opened; the text contains its path and the reason."""


class SerialLine:
    """A serial adapter with the interface of a PtyLine; the transfer takes its real time.

    Bytes that the adapter cannot accept are counted (`overrun_bytes`), as on a pty. If the adapter is unplugged,
    `is_plugged` is False from then on.
    """

    def __init__(self, path: str, baud: int) -> None:
        """Open the adapter exclusively; raise SerialLineError if that fails."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise SerialLineError(f"{path}: {error}") from None
        self._descriptor: int = self._port.fileno()
        os.set_blocking(self._descriptor, False)
        self._poll = select.poll()
        self._poll.register(self._descriptor, select.POLLHUP | select.POLLERR)

    @property
    def is_plugged(self) -> bool:
        """True while the adapter is present."""
        return self._descriptor >= 0

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1 without the adapter."""
        return self._descriptor

    def close(self) -> None:
        """Release the adapter."""
        self._descriptor = -1
        self._port.close()

    def read(self) -> bytes:
        """Return the received bytes, without waiting."""
        try:
            data = os.read(self._descriptor, _READ_SIZE) if self.is_plugged else b""
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        if not data and self.is_plugged and self._poll.poll(0):
            self.close()  # an event without data: the adapter is unplugged
        self.total_read += len(data)
        return data

    def write(self, data: bytes) -> int:
        """Write bytes and return the number accepted."""
        sent = 0
        try:
            while self.is_plugged and sent < len(data):
                sent += os.write(self._descriptor, data[sent:])
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self.close()
        self.total_written += sent
        self.overrun_bytes += len(data) - sent
        return sent
