"""What the loop asks of the world: the Protocols that drivers, links and the clock fulfil.

All of them are non-blocking and none raises inside a tick: a fault becomes a
`DeviceHealth` record.
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
    DeviceHealth,
    HeadingSample,
    Inputs,
    PositionSample,
    PowerSample,
    Progress,
    RudderCommand,
    RudderFeedback,
    Stored,
)
from firmware_py.common.reports import Output, SwingReport
from firmware_py.common.vessels import VesselReport


class ByteLine(Protocol):
    """A serial line that may vanish and come back."""

    @property
    def name(self) -> str:
        """The path of the port, for messages."""

    @property
    def baud(self) -> int:
        """Bits a second."""

    @property
    def openings(self) -> int:
        """How often the line has been opened; a driver that sees it change starts its device again."""

    @property
    def connected(self) -> bool:
        """Whether the line is open now."""

    def fileno(self) -> int:
        """The descriptor to wait on, or -1 while the line is away."""

    def read(self) -> bytes:
        """All bytes that are there, at most 4096; empty when there are none or the line is away."""

    def write(self, data: bytes) -> bool:
        """Hand all of data to the line, or none of it (False: away or its buffer is full)."""


class Device(Protocol):
    """What every driver has."""

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""

    def receive(self, now_s: float) -> None:
        """Read what has arrived and decode it, stamped now_s; bounded work."""

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the device and its counters at now_s."""


class Compass(Device, Protocol):
    """A heading sensor."""

    def poll(self) -> Sequence[HeadingSample]:
        """The samples since the last poll, oldest first."""


class Calibrator(Protocol):
    """A compass that can calibrate itself while it is turned; it gives no headings meanwhile."""

    def calibrate(self, now_s: float) -> bool:
        """Begin; False when it is under way or the compass is not there."""

    def calibration(self) -> Calibration:
        """How far it is, or how the last one ended."""

    def call_off(self) -> None:
        """End it without a result."""


class CompassSwing(Protocol):
    """Looks on while she sails, and finds the deviation of compass A; nothing is set by it."""

    former: Mapping[str, float] | None  # parameters as they were before a proposal was accepted, to go back to

    @property
    def report(self) -> SwingReport:
        """How far it is, and what is proposed."""

    def begin(self, parameters: ParameterSet) -> None:
        """Begin anew."""

    def end(self, former: Mapping[str, float] | None = None) -> None:
        """End it, and forget what was found; `former`: what its acceptance has replaced."""


class Position(Device, Protocol):
    """A position sensor."""

    def poll(self) -> Sequence[PositionSample]:
        """The fixes since the last poll, oldest first."""


class Power(Device, Protocol):
    """A monitor of the battery, or a charger."""

    def poll(self) -> Sequence[PowerSample]:
        """The samples since the last poll, oldest first."""


class Vessels(Device, Protocol):
    """A receiver of what other vessels say of themselves."""

    def poll(self) -> Sequence[VesselReport]:
        """The reports since the last poll, a bounded number, positions first."""


class Rudder(Device, Protocol):
    """A rudder servo."""

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the command and ask for the state, in one bounded exchange."""

    def needs_prompt_io(self) -> bool:
        """Whether its bytes must be taken as they come; else the next tick is soon enough."""

    def poll(self) -> Sequence[RudderFeedback]:
        """The feedback since the last poll, oldest first."""


class Clock(Protocol):
    """The only reader of time."""

    def now_s(self) -> float:
        """Seconds on the monotonic clock since the process started."""

    def utc_s(self) -> float:
        """Seconds since 1970-01-01 UTC, as far as the machine knows."""

    def wait(self, deadline_s: float, descriptors: Sequence[int]) -> Sequence[int]:
        """Sleep until the deadline or until a descriptor is readable; return those that are."""


class RequestHandler(Protocol):
    """The side of the loop that the link talks to, on the loop's own thread."""

    @property
    def compass_swing(self) -> CompassSwing:
        """What finds the compass's deviation under way."""

    def decide(self, request: Request) -> Answer:
        """Judge a request at once; when accepted it is in force, and an input of the next tick."""

    def decide_together(self, requests: Sequence[Request]) -> Answer:
        """Judge requests one after the other: all are accepted, or none and the answer is that to the first refused."""

    def parameters(self) -> ParameterSet:
        """The values in force, accepted requests included."""

    def plans(self) -> Plans:
        """The plans in force, accepted requests included."""

    def replace_plan(self, request: Request, done: Callable[[Answer], None]) -> None:
        """Put the plan of a ReplacePlan request in force once it is on disk; the old one stands until then.

        `done` is called once, on the loop's thread, at once for a refusal.
        """

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once the parameters accepted are on disk (True) or cannot be (False)."""

    def when_orders_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once the next start would go on with what was accepted so far (True).

        False when that cannot be stored. At once where nothing is to be gone on with (BOOT_RESUME 0).
        """


class StateWriter(Protocol):
    """Keeps over restarts what was accepted, in the background."""

    def save_parameters(self, changed: Mapping[str, float]) -> None:
        """Keep parameters that were set."""

    def clear_parameters(self) -> None:
        """Forget all parameters that were set, or none when this cannot be stored."""

    def save_plan(self, plan: Plan, done: Callable[[bool], None]) -> None:
        """Keep a plan in place of the one of its kind, which stays when this cannot be stored; `done` says which."""

    def save_resume(self, record: bytes) -> None:
        """Keep a resume record in place of the last one."""

    def when_parameters_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once the parameters are on disk (True) or cannot be (False).

        The resume record, which some of them change, too.
        """

    def when_resume_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once the resume record is on disk (True) or cannot be (False)."""


class Vault(Protocol):
    """Where a secret is kept over restarts."""

    def load(self) -> Stored:
        """Return what was saved last."""

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Keep this instead, in the background; `both_slots`: so that nothing is left of what was kept before."""

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once this is on disk (True) or cannot be (False)."""


class Link(Protocol):
    """The ground stations' side: reads in the slack between ticks, publishes after each tick."""

    @property
    def busy(self) -> bool:
        """Whether something already read still waits for `service`."""

    @property
    def station_s(self) -> float | None:
        """When a ground station was last heard, None when none has been."""

    @property
    def key_problem(self) -> str:
        """How the signing key was lost; empty when it was not."""

    def descriptors(self) -> Sequence[int]:
        """The descriptors whose readability `service` wants."""

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Read and answer a bounded piece of what has arrived; called again while there is time."""

    def publish(self, output: Output, now_s: float) -> None:
        """Take the output of a tick, send what is due, bounded."""

    def status(self, now_s: float) -> Sequence[LinkStatus]:
        """Return who is on each link, and how it fares."""

    def progress(self) -> Sequence[Progress]:
        """What its threads have done."""


class Recorder(Protocol):
    """The onboard log."""

    def offer(self, inputs: Inputs, output: Output, before: Callable[[], str]) -> None:
        """Queue a tick without blocking, or drop and count it.

        `before` gives the state before this tick as text; it is called only when the
        log needs a checkpoint (a new file, or the first tick after a drop).
        """

    def health(self, now_s: float) -> DeviceHealth:
        """Whether the log is being written; `rejected` counts the ticks dropped."""

    def progress(self) -> Sequence[Progress]:
        """What its thread has done."""

    def close(self) -> None:
        """Write what is queued and close the file."""
