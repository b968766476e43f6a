"""Guard around a third-party driver.

An exception or an invalid sample makes the device FAILED; it never ends the autopilot. Code that does not return is
beyond this guard: the watchdog of the service ends the process.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from pathlib import PurePath
from typing import Any, Final

import msgspec

from firmware_py.common.driver import Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand

RETRY_S: Final = 10.0  # after an exception, before the driver is created again
MAX_SAMPLES: Final = 100  # of one poll; further ones are dropped
MAX_SAMPLE_AGE_S: Final = 60.0  # a driver stamps its samples with the time of `receive` or `command`
MAX_NUMBER: Final = 1e10  # larger than any value in the units of the records, also UTC; its square does not overflow
_MAX_INTEGERS: Final = {"status": 255}  # as the log stores them; all others have 32 bits, and none is negative
_MAX_TEXT: Final = 200  # characters of a text
# Ranges of angles: degrees in place of radians are the most probable error of a driver.
_RANGES: Final = {
    "heading_rad": (0.0, math.tau),
    "roll_rad": (-math.pi, math.pi),
    "pitch_rad": (-math.pi / 2.0, math.pi / 2.0),
    "latitude_rad": (-math.pi / 2.0, math.pi / 2.0),
    "longitude_rad": (-math.pi, math.pi),
    "course_over_ground_rad": (0.0, math.tau),
    "rudder_rad": (-math.pi, math.pi),
}


class GuardedDevice:
    """A driver that may raise; it is created at the first `receive`, and again RETRY_S after an exception."""

    def __init__(
        self,
        driver: Driver[Any],
        role: DeviceRole,
        sample_types: tuple[type[Any], ...],
        package: str,
        line: ByteLine,
        options: Any,
    ) -> None:
        """Store the driver; `package` is name and version, for messages."""
        self._driver = driver
        self._role = role
        self._sample_types = sample_types
        self._package = package
        self._line = line
        self._options = options
        self._device: Any = None
        self._retry_s = -math.inf
        self._fault = driver.problem
        self._fault_count = 0
        self._now_s = 0.0  # the latest

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Let the driver read; without a driver the received bytes are discarded."""
        self._now_s = max(self._now_s, now_s)
        if self._device is None and not self._driver.problem and now_s >= self._retry_s:
            self._device = self._guard(None, self._driver.make, self._line, self._options)
        if self._device is None:
            self._line.read()
        else:
            self._guard(None, self._call, "receive", now_s)

    def poll(self) -> Sequence[Any]:
        """Return the samples since the last poll; an invalid one makes the device FAILED."""
        return () if self._device is None else self._guard((), self._read_samples)

    def health(self, now_s: float) -> DeviceHealth:
        """Return the driver's record.

        Without a driver the state is STARTING, FAILED after an exception, or FAULTY if it could not be loaded.
        """
        health: DeviceHealth | None = None if self._device is None else self._guard(None, self._read_health, now_s)
        if health is None:
            state = DeviceState.FAILED if self._fault else DeviceState.STARTING
            state = DeviceState.FAULTY if self._driver.problem else state  # reported at the start
            return DeviceHealth(now_s, self._role, state, 0, self._fault_count, self._fault[:_MAX_TEXT])
        return health

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Let the driver of a servo send the command."""
        self._now_s = max(self._now_s, now_s)
        if self._device is not None:
            self._guard(None, self._call, "command", command, now_s)

    def needs_prompt_io(self) -> bool:
        """Return whether the driver of a servo must read at once."""
        return self._device is not None and bool(self._guard(False, self._call, "needs_prompt_io"))

    def _guard(self, default: Any, call: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a call; after an exception, `default`, and the driver is dropped."""
        try:
            return call(*arguments)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - third-party code
            self._device = None
            self._retry_s = self._now_s + RETRY_S
            self._fault_count += 1
            frame = traceback.extract_tb(error.__traceback__)[-1]
            location = "" if frame.filename == __file__ else f" ({PurePath(frame.filename).name}:{frame.lineno})"
            reason = traceback.format_exception_only(error)[-1].strip()  # does not raise even if str(error) does
            self._fault = f"driver of package {self._package}: {reason}{location}"
            return default

    def _call(self, method: str, *arguments: Any) -> Any:
        return getattr(self._device, method)(*arguments)

    def _read_samples(self) -> Sequence[Any]:
        samples = self._device.poll()
        if not isinstance(samples, Iterable):
            raise TypeError(f"poll() returned {type(samples).__name__}, not the samples")
        return [self._check(sample) for sample in islice(samples, MAX_SAMPLES)]

    def _check(self, sample: Any) -> Any:
        """Return a sample with source 0; raise TypeError or ValueError if its class, type or a value is invalid.

        The check rejects values that would stop the autopilot or damage the log; values in range may still be wrong.
        """
        if not isinstance(sample, self._sample_types):
            raise TypeError(f"{type(sample).__name__} is not a sample of this device")
        values = _check_values(msgspec.structs.asdict(sample))
        for name, (low, high) in _RANGES.items():
            if isinstance(value := values.get(name), float) and not low <= value <= high:
                raise ValueError(f"{name} is {value:.6g}, expected {low:.4g} to {high:.4g} radians")
        if not 0.0 <= self._now_s - values["t_s"] <= MAX_SAMPLE_AGE_S:
            raise ValueError(f"t_s is {values['t_s']}, now is {self._now_s}")
        return msgspec.convert(values | {"source": 0} if "source" in values else values, type(sample))

    def _read_health(self, now_s: float) -> DeviceHealth:
        health = self._device.health(now_s)
        if not isinstance(health, DeviceHealth):
            raise TypeError(f"health() returned {type(health).__name__}")
        values = msgspec.structs.asdict(health) | {"t_s": now_s, "role": self._role, "text": health.text[:_MAX_TEXT]}
        return msgspec.convert(_check_values(values), DeviceHealth)


def _check_values(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values; raise ValueError for a number or a text that is too large, or a negative integer."""
    for name, value in values.items():
        for item in value if isinstance(value, tuple) else (value,):
            if isinstance(item, float):
                is_valid = abs(item) <= MAX_NUMBER
            elif isinstance(item, int):
                is_valid = 0 <= item <= _MAX_INTEGERS.get(name, 0xFFFF_FFFF)
            else:
                is_valid = not isinstance(item, str) or len(item) <= _MAX_TEXT
            if not is_valid:
                raise ValueError(f"{name} is {str(item)[:30]}")
    return values
