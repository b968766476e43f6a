"""Driver of a Volz DA servo as the rudder actuator.

The servo has no settings that the driver needs, no torque switch, no error report and no start-up procedure. Every tick
sets the position, and the reply is the measured angle; then it reads one of voltage, current and temperature in turn.
An exchange has 12 bytes, 1.04 ms at 115200 baud, and takes up to 1.56 ms with the response time of the servo. The next
request waits for the reply or the timeout.

* Silence is the only detectable fault. The driver continues to send the position, so the servo follows again with the
  first frame after a power loss.
* The motor cannot be released: with `torque_on` False no position is sent, the servo holds the last one, and only
  voltage, current and temperature are read. The angle is then unknown, and `RudderFeedback.torque_on` is None.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import msgspec

from firmware_py.actuator import volz_frames as frames
from firmware_py.actuator.half_duplex import ReadingWindow, reply_timeout_s
from firmware_py.actuator.servo_driver import ReplyResult, ServoDriver
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceState, RudderFeedback

MAX_EXCHANGE_BYTES = 23  # 6 and 6, and 11 for the response time of the servo (0.5 ms)


@dataclass(frozen=True, slots=True)
class VolzOptions:
    """Options of the vehicle file for a Volz; raises ValueError."""

    id: int = option("id of the servo on its bus", default=1, minimum=1, maximum=30)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Request(msgspec.Struct, frozen=True):
    """A frame and its code."""

    code: int
    frame: bytes


class VolzServo:
    """A servo_driver.Servo; shaft angle 0 is count 0x0800, positive is increasing counts."""

    def __init__(self, options: VolzOptions) -> None:
        """Start without a command."""
        self.device_id = options.id
        self.label = f"servo id {options.id}"
        self.parser = frames.ReplyParser(options.id)
        self._window = ReadingWindow()
        self._readings = deque(
            Request(code, frames.request(code, options.id))
            for code in (frames.READ_VOLTAGE, frames.READ_CURRENT, frames.READ_TEMPERATURE)
        )
        self._shaft_rad: float | None = None
        self._torque_command = False
        self._is_position_due = False
        self._is_reading_due = False
        self._last_reading_s = -math.inf
        self.restart()

    def restart(self) -> None:
        """Discard the readings: the line was reopened."""
        self._voltage_v: float | None = None
        self._current_a: float | None = None
        self._temperature_c: float | None = None

    def note_silence(self) -> None:
        """Discard the readings: they are outdated."""
        self.restart()

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Store the position and whether to send it."""
        self._shaft_rad = shaft_rad
        self._torque_command = torque_on
        self._window.note_command(now_s)
        self._is_position_due = self._is_reading_due = True

    def condition(self, *, has_replied: bool) -> tuple[DeviceState, str]:
        """Return the state; silence is the only detectable fault."""
        if not has_replied:
            return DeviceState.STARTING, f"no reply from {self.label}"
        return DeviceState.RUNNING, "" if self._torque_command else "no position sent; the servo holds the last one"

    def matches(self, reply: frames.Reply, request: Request) -> bool:
        """Return whether the code of the reply belongs to that of the request."""
        return reply.code == frames.REPLY_CODES_BY_REQUEST[request.code]

    def process_reply(self, _request: Request, reply: frames.Reply, sent_s: float, *, is_certain: bool) -> ReplyResult:  # noqa: ARG002 - the code identifies the reply
        """Store a reading; there is feedback for each angle, or for each reading while there are no angles."""
        shaft_rad = None
        if reply.code == frames.POSITION_REPLY:
            value = shaft_rad = reply.shaft_rad()
        elif reply.code == frames.VOLTAGE_REPLY:
            value = self._voltage_v = reply.voltage_v()
        elif reply.code == frames.CURRENT_REPLY:
            value = self._current_a = reply.current_a()
        else:
            value = self._temperature_c = reply.temperature_c()
        has_feedback = reply.code == frames.POSITION_REPLY or not self._torque_command
        return ReplyResult(
            invalid_values=value is None, feedback=self._create_feedback(shaft_rad, sent_s) if has_feedback else None
        )

    def _create_feedback(self, shaft_rad: float | None, sent_s: float) -> RudderFeedback:
        return RudderFeedback(
            t_s=sent_s,
            shaft_rad=shaft_rad,
            temperature_c=self._temperature_c,
            voltage_v=self._voltage_v,
            current_a=self._current_a,
            torque_on=True if self._torque_command else None,
        )

    def next_request(self, now_s: float) -> Request | None:
        """Return the position if it is due, otherwise a reading that does not delay the next one."""
        if self._is_position_due and self._torque_command and self._shaft_rad is not None:
            return Request(frames.SET_POSITION, frames.set_position(self.device_id, self._shaft_rad))
        is_overdue = self._window.is_overdue(now_s - self._last_reading_s)
        if is_overdue or (self._is_reading_due and self._window.is_early(now_s)):
            return self._readings[0]
        return None

    def needs_prompt_io(self) -> bool:
        """Return whether the position or a reading is due."""
        return (self._is_position_due and self._torque_command) or self._is_reading_due

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request was sent."""
        if request.code == frames.SET_POSITION:
            self._is_position_due = False
        else:
            self._readings.rotate(-1)
            self._is_reading_due = False
            self._last_reading_s = now_s

    def note_lost(self, request: Request) -> None:
        """Do nothing: the next command repeats the position, and the readings are repeated in turn."""


def volz_rudder(line: ByteLine, options: VolzOptions) -> ServoDriver[Request, frames.Reply]:
    """Return the driver of a Volz servo on a line."""
    timeout_s = reply_timeout_s(line.baud, MAX_EXCHANGE_BYTES)
    return ServoDriver(line, VolzServo(options), reply_timeout_s=timeout_s)


DRIVER = Driver(interface=INTERFACE, device="Volz DA", options=VolzOptions, make=volz_rudder, writes=True)
