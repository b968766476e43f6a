"""Protocols of drivers, links and clock, as the loop uses them.

All methods are non-blocking and do not raise during a tick: a fault is reported as a `DeviceHealth` record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from firmware_py.common.intents import Answer, Request
from firmware_py.common.link_status import LinkStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, Plans
from firmware_py.common.records import (
    Calibration,
    DepthSample,
    DeviceHealth,
    HeadingSample,
    Inputs,
    PositionSample,
    PowerSample,
    Progress,
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    Stored,
    WindSample,
)
from firmware_py.common.reports import Output, SwingReport
from firmware_py.common.vessels import VesselReport


class ByteLine(Protocol):
    """A serial line that may disappear and return."""

    @property
    def name(self) -> str:
        """The path of the port, for messages."""

    @property
    def baud(self) -> int:
        """Bits per second."""

    @property
    def openings(self) -> int:
        """Number of times the line was opened; a driver restarts its device when it changes."""

    @property
    def connected(self) -> bool:
        """Whether the line is open now."""

    def fileno(self) -> int:
        """The descriptor to wait on, or -1 while the line is closed."""

    def read(self) -> bytes:
        """The available bytes, at most 4096; empty if there are none or the line is closed."""

    def write(self, data: bytes) -> bool:
        """Write all of data, or nothing and return False (line closed or buffer full)."""


class Device(Protocol):
    """Common methods of all drivers."""

    def fileno(self) -> int:
        """The descriptor that `receive` reads, or -1."""

    def receive(self, now_s: float) -> None:
        """Read and decode the available bytes, a bounded number, with time stamp now_s."""

    def health(self, now_s: float) -> DeviceHealth:
        """State and counters of the device at now_s."""


class Compass(Device, Protocol):
    """A heading sensor."""

    def poll(self) -> Sequence[HeadingSample]:
        """The samples since the last poll, oldest first."""


class Calibrator(Protocol):
    """A compass with a calibration of its own, during which it gives no headings."""

    def calibrate(self, now_s: float) -> bool:
        """Start the calibration; False if it is running or the compass is missing."""

    def calibration(self) -> Calibration:
        """Progress, or result of the last calibration."""

    def cancel(self) -> None:
        """Cancel the calibration."""


class CompassSwing(Protocol):
    """Estimates the deviation of compass A under way; it sets no parameter."""

    former: Mapping[str, float] | None  # parameters before a proposal was accepted, to restore them

    @property
    def report(self) -> SwingReport:
        """Progress and proposal."""

    def begin(self, parameters: ParameterSet) -> None:
        """Start a swing."""

    def end(self, former: Mapping[str, float] | None = None) -> None:
        """End the swing and discard its result; `former`: parameters replaced by accepting it."""


class Position(Device, Protocol):
    """A position sensor."""

    def poll(self) -> Sequence[PositionSample]:
        """The fixes since the last poll, oldest first."""


class Power(Device, Protocol):
    """A monitor of the battery, or a charger."""

    def poll(self) -> Sequence[PowerSample]:
        """The samples since the last poll, oldest first."""


class Vessels(Device, Protocol):
    """An AIS receiver."""

    def poll(self) -> Sequence[VesselReport]:
        """The reports since the last poll, a bounded number, positions first."""


class Wind(Device, Protocol):
    """A wind sensor."""

    def poll(self) -> Sequence[WindSample]:
        """The samples since the last poll, a bounded number, oldest first."""


class Depth(Device, Protocol):
    """An echo sounder."""

    def poll(self) -> Sequence[DepthSample]:
        """The samples since the last poll, a bounded number, oldest first."""


class Rudder(Device, Protocol):
    """A rudder servo."""

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the command and request the state, in one bounded exchange."""

    def needs_prompt_io(self) -> bool:
        """Return whether bytes must be read at once, before the next tick."""

    def poll(self) -> Sequence[RudderFeedback]:
        """The feedback since the last poll, oldest first."""


class RudderAngle(Device, Protocol):
    """A sensor of the rudder angle, separate from the servo."""

    def poll(self) -> Sequence[RudderAngleSample]:
        """The samples since the last poll, oldest first."""


class Clock(Protocol):
    """The only reader of time."""

    def now_s(self) -> float:
        """Seconds on the monotonic clock since the process started."""

    def utc_s(self) -> float:
        """Seconds since 1970-01-01 UTC by the clock of the computer."""

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Sleep until the deadline or until a descriptor is readable; return the readable ones."""


class RequestHandler(Protocol):
    """Interface of the autopilot to the link, on the thread of the loop."""

    @property
    def compass_swing(self) -> CompassSwing:
        """The compass swing."""

    def decide(self, request: Request) -> Answer:
        """Answer a request at once; if accepted, it takes effect with the next tick."""

    def decide_together(self, requests: Sequence[Request]) -> Answer:
        """Answer requests in order; either all are accepted, or none and the first refusal is returned."""

    def parameters(self) -> ParameterSet:
        """The present values, including accepted requests."""

    def plans(self) -> Plans:
        """The present plans, including accepted requests."""

    def replace_plan(self, request: Request, done: Callable[[Answer], None]) -> None:
        """Activate the plan of a ReplacePlan request once it is on disk; the old one stays active until then.

        `done` is called once, on the loop's thread; at once if the plan is refused.
        """

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when accepted parameters are on disk (True) or cannot be stored (False)."""

    def when_orders_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when a restart would resume all accepted commands (True).

        False if they cannot be stored. Without BOOT_RESUME it is called at once (True).
        """


class StateWriter(Protocol):
    """Stores accepted changes over restarts, in the background."""

    def save_parameters(self, changed: Mapping[str, float]) -> None:
        """Store changed parameters."""

    def clear_parameters(self) -> None:
        """Delete all parameters that were set; none if this cannot be stored."""

    def save_plan(self, plan: Plan, done: Callable[[bool], None]) -> None:
        """Replace the stored plan of a kind; `done` is called with False if that fails and the old one remains."""

    def save_resume(self, record: bytes) -> None:
        """Replace the stored resume record."""

    def when_parameters_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when the parameters are on disk (True) or cannot be stored (False).

        The same applies to the resume record, which some parameters change.
        """

    def when_resume_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when the resume record is on disk (True) or cannot be stored (False)."""


class Vault(Protocol):
    """Store of a secret over restarts."""

    def load(self) -> Stored:
        """Return the last saved content."""

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Replace the content in the background; `both_slots`: overwrite both slots to erase the old content."""

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when the content is on disk (True) or cannot be stored (False)."""


class Link(Protocol):
    """The link to ground stations: receives between ticks, sends after each tick."""

    @property
    def busy(self) -> bool:
        """Whether received data wait for `service`."""

    @property
    def station_s(self) -> float | None:
        """Time of the last message from a ground station, None before the first."""

    @property
    def key_problem(self) -> str:
        """Problem with the signing key, empty if there is none."""

    def descriptors(self) -> Sequence[int]:
        """The descriptors that `service` reads."""

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Read and answer a bounded part of the received data; called again while there is time."""

    def publish(self, output: Output, now_s: float) -> None:
        """Send the messages that are due after a tick; bounded work."""

    def status(self, now_s: float) -> Sequence[LinkStatus]:
        """Return the status of each link and its peers."""

    def progress(self) -> Sequence[Progress]:
        """Progress of its threads."""


class Recorder(Protocol):
    """The onboard log."""

    def offer(self, inputs: Inputs, output: Output, previous_state: Callable[[], str]) -> None:
        """Queue a tick without blocking, or drop and count it.

        `previous_state` returns the state before this tick as text; it is called only if the log needs a checkpoint (in
        a new file, or after a dropped tick).
        """

    def health(self, now_s: float) -> DeviceHealth:
        """State of the log; `rejected` counts dropped ticks."""

    def progress(self) -> Sequence[Progress]:
        """Progress of its thread."""

    def close(self) -> None:
        """Write the queued ticks and close the file."""
