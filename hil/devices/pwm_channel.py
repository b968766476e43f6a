"""A PWM output: a directory that imitates a chip of /sys/class/pwm, with one channel.

`duty_cycle` is a named pipe, so that each pulse width which the autopilot writes is received once and at once. The
other attributes are plain files.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

_READ_SIZE = 4096
_CLOSED = -1
PERIOD_NS = 20_000_000


class PwmChannel:
    """A channel with the interface of a PtyLine; `unplug` removes the chip, as if its driver were unloaded."""

    def __init__(self, directory: Path) -> None:
        """Create the chip with an exported channel 0."""
        self.overrun_bytes = 0
        self.total_read = 0
        self.total_written = 0
        self._chip = Path(directory)
        self._channel = self._chip / "pwm0"
        self._fd = _CLOSED
        self.plug()

    @property
    def address(self) -> str:
        """The port of the vehicle file."""
        return f"pwm:{self._chip}/0"

    @property
    def is_plugged(self) -> bool:
        """True while the chip exists."""
        return self._fd != _CLOSED

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1 without the chip."""
        return self._fd

    def plug(self) -> None:
        """Create the chip; no effect if it exists."""
        if self.is_plugged:
            return
        self._channel.mkdir(parents=True)
        attributes = {"period": str(PERIOD_NS), "enable": "0", "polarity": "normal"}
        for name, text in attributes.items():
            (self._channel / name).write_text(f"{text}\n")
        for name in ("export", "unexport"):
            (self._chip / name).touch()
        os.mkfifo(self._channel / "duty_cycle")
        self._fd = os.open(self._channel / "duty_cycle", os.O_RDWR | os.O_NONBLOCK)
        self.total_read = 0

    def unplug(self) -> None:
        """Remove the chip; no effect without it."""
        if not self.is_plugged:
            return
        shutil.rmtree(self._chip)
        os.close(self._fd)
        self._fd = _CLOSED

    def close(self) -> None:
        """Remove the chip."""
        self.unplug()

    def read(self) -> bytes:
        """Return the pulse widths that were written, one a line, without waiting."""
        return self._read(_READ_SIZE)

    def read_until_total(self, total: int) -> bytes:
        """Return the bytes up to a total; those that were written are in the pipe."""
        return self._read(max(0, total - self.total_read))

    def write(self, data: bytes) -> int:
        """Return 0: nothing can be sent."""
        self.overrun_bytes += len(data)
        return 0

    def _read(self, size: int) -> bytes:
        if not self.is_plugged or not size:
            return b""
        try:
            data = os.read(self._fd, size)
        except BlockingIOError:
            return b""
        self.total_read += len(data)
        return data
