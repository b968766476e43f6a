"""A PWM output of the computer as a write-only byte line, `pwm:/sys/class/pwm/pwmchip0/0`.

The number is the channel of the chip. The line exports it, sets a period of 20 ms, and sets each pulse width that is
written to it: a decimal number of nanoseconds and a line feed; 0 disables the output. Closing leaves the last pulse,
which the kernel repeats, so that the servo holds the rudder while the program restarts. Source:
Documentation/driver-api/pwm and Documentation/ABI/testing/sysfs-class-pwm of the Linux kernel.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

from firmware_py.system.serial_port import REOPEN_INTERVAL_S, PortError

PERIOD_NS = 20_000_000
MAX_PULSE_NS = 3_000_000  # of any hobby servo; a longer one could be a wrong unit
NAME_FORMAT = "pwm:CHIP/CHANNEL, as in pwm:/sys/class/pwm/pwmchip0/0"


class PwmLine:
    """A channel of a PWM chip as a ByteLine; `open` or `reopen` exports it."""

    def __init__(self, name: str, baud: int = 0) -> None:
        """Store the name; `baud` has no meaning."""
        self.name = name
        self.baud = baud
        self.openings = 0
        self.written = 0
        self._channel: Path | None = None  # while the output is open
        self._is_enabled: bool | None = None  # None: not known
        self._next_retry_s = 0.0

    @property
    def connected(self) -> bool:
        """Whether the output is open."""
        return self._channel is not None

    def fileno(self) -> int:
        """Return -1: there is nothing to read."""
        return -1

    def read(self) -> bytes:
        """Return no bytes."""
        return b""

    def open(self) -> None:
        """Export the channel and set its period; raises PortError with the remedy.

        A channel that has just been exported may belong to root until udev has changed its group. It is then opened by
        `reopen`.
        """
        chip, channel = self._parts()
        directory = chip / f"pwm{channel}"
        is_exported = _is_directory(directory)
        try:
            if not is_exported:
                _write(chip / "export", channel.encode())
            self._set_up(directory)
        except (OSError, ValueError) as error:
            if not is_exported and _is_directory(directory) and isinstance(error, PermissionError):
                return
            raise PortError(f"port {self.name}: {_explain_error(chip, error)}") from None

    def reopen(self, now_s: float) -> str:
        """Once a second, try to open a closed output; return an empty report."""
        if self._channel is None and now_s >= self._next_retry_s:
            self._next_retry_s = now_s + REOPEN_INTERVAL_S
            try:
                self.open()
            except PortError:
                pass
        return ""

    def write(self, data: bytes) -> bool:
        """Set a pulse width; return False if it is invalid or the output is lost, which is then opened again."""
        text = data[:-1]
        if self._channel is None or not (data.endswith(b"\n") and len(text) <= 8 and text.isdigit()):
            return False
        pulse_ns = int(text)
        if pulse_ns > MAX_PULSE_NS:
            return False
        try:
            _write(self._channel / "duty_cycle", data)
            if self._is_enabled is not bool(pulse_ns):
                _write(self._channel / "enable", b"1\n" if pulse_ns else b"0\n")
        except OSError:
            self._channel = None
            return False
        self._is_enabled = bool(pulse_ns)
        self.written += len(data)
        return True

    def close(self) -> None:
        """Close the output; its last pulse continues."""
        self._channel = None

    def _parts(self) -> tuple[Path, str]:
        """Return directory of the chip and number of the channel; raises PortError."""
        chip, _, channel = self.name.partition(":")[2].rpartition("/")
        if not (chip.startswith("/") and channel.isascii() and channel.isdecimal() and len(channel) <= 3):
            raise PortError(f"port {self.name}: write {NAME_FORMAT}")
        return Path(chip), str(int(channel))

    def _set_up(self, directory: Path) -> None:
        """Set polarity and period, which the kernel changes only in this order; keep a pulse that is running."""
        polarity = directory / "polarity"
        if polarity.exists() and polarity.read_text().strip() == "inversed":
            _write(directory / "enable", b"0\n")
            _write(polarity, b"normal\n")
        if (directory / "period").read_text().strip() != str(PERIOD_NS):
            if (directory / "duty_cycle").read_text().strip() != "0":
                _write(directory / "duty_cycle", b"0\n")  # the period cannot be shorter than the pulse
            _write(directory / "period", b"%d\n" % PERIOD_NS)
        self._is_enabled = None
        self._channel = directory
        self.openings += 1
        self.written = 0


def _write(file: Path, data: bytes) -> None:
    """Write an attribute with a single call, as the kernel expects; never wait, because the file may be a pipe."""
    descriptor = os.open(file, os.O_WRONLY | os.O_TRUNC | os.O_NONBLOCK)
    try:
        os.write(descriptor, data)
    finally:
        os.close(descriptor)


def _is_directory(path: Path) -> bool:
    """Return whether a path is a directory; False if it cannot be looked up, for which Path.is_dir raises."""
    try:
        return path.is_dir()
    except OSError:
        return False


def _explain_error(chip: Path, error: Exception) -> str:
    if not _is_directory(chip):
        return "no such PWM chip; load its overlay (pwm) and correct the path in the vehicle file"
    if isinstance(error, PermissionError):
        return "permission denied; give the group of the service access to /sys/class/pwm (udev rule)"
    code = error.errno if isinstance(error, OSError) else None
    if code == errno.EROFS:
        return f"hidden by the service; add ReadWritePaths={chip.resolve()} to its drop-in (how-to: hobby servo)"
    reason = os.strerror(code).lower() if code else "not usable"
    return f"{reason}; the channel does not exist or another driver uses it"
