"""Description of a device driver, as the registry (devices.py) and packages of other authors define it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from firmware_py.common.interfaces import ByteLine, Calibrator

DeviceT = TypeVar("DeviceT")

# Version of the interface between the autopilot and a driver: Driver, the protocols of common/interfaces.py and the
# records of common/records.py that a driver creates. It changes when earlier drivers would no longer work.
INTERFACE: Final = 1


@dataclass(frozen=True, slots=True)
class CaptureFormat:
    """A protocol of `rambler decode`: its name, and a function that yields one result per message of a capture."""

    name: str
    decode: Callable[[bytes], Iterator[dict[str, Any]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver(Generic[DeviceT]):
    """A driver: its option record (common.options), and a factory that creates it from a line and that record.

    `interface` is the version of the interface that it was written for (INTERFACE at that time), `device` the devices
    that it serves, for the documentation. A driver that `writes` to its device needs a serial port; the others can also
    read from the network. A compass without north (`has_north` False) measures turns only (NorthReference.RELATIVE) and
    is refused as the first compass. `calibrator` returns the calibrator of a device, None if it has none; `capture` is
    the format for `rambler decode`. `port` is the prefix of the port of a driver that needs another kind of line, such
    as `pwm:`. A driver that reads the frames of system/can_line.py, and so accepts `can:`, has `reads_can`. `problem`
    is why the driver of an installed package cannot be used, set by the registry.
    """

    interface: int
    device: str
    options: type[Any]
    make: Callable[[ByteLine, Any], DeviceT]
    writes: bool = False
    has_north: bool = True
    calibrator: Callable[[Any], Calibrator] | None = None
    capture: CaptureFormat | None = None
    port: str = ""
    reads_can: bool = False
    problem: str = ""
