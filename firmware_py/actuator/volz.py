"""A Volz DA servo as the rudder.

The servo keeps no settings that the driver needs and has no torque switch, no error
report and no start-up: every tick sets the position, whose reply is the measured angle,
and then asks in turn for one of voltage, current and temperature. An exchange is 12 bytes,
1.04 ms at 115200 baud, and the servo takes up to 1.56 ms for it; the next request waits
for the reply or for the timeout.

* Silence is the only fault that can be seen. The driver goes on sending the position, so
  the servo follows again with the first frame it hears after a power loss.
* The motor cannot be released: with `torque_on` False no position is sent, the servo holds
  the last one by itself, and only voltage, current and temperature are read. The angle is
  then not known, and `RudderFeedback.torque_on` is None.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import msgspec

from firmware_py.actuator import volz_frames as frames
from firmware_py.actuator.half_duplex import Pace, reply_timeout_s
from firmware_py.actuator.servo_driver import Answer, ServoDriver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceState, RudderFeedback

LONGEST_EXCHANGE_BYTES = 23  # six and six, and half a millisecond in which the servo thinks


@dataclass(frozen=True, slots=True)
class VolzOptions:
    """What the vehicle file may say of a Volz; ValueError for what cannot be."""

    id: int = option("number of the servo on its bus", default=1, minimum=1, maximum=30)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Request(msgspec.Struct, frozen=True):
    """A frame and its code."""

    code: int
    frame: bytes


class VolzServo:
    """A servo_driver.Servo; shaft angle 0 is 0x0800, positive is increasing counts."""

    def __init__(self, options: VolzOptions) -> None:
        """Begin without a command."""
        self.device_id = options.id
        self.parser = frames.ReplyParser(options.id)
        self._pace = Pace()
        self._readings = deque(
            Request(code, frames.request(code, options.id))
            for code in (frames.READ_VOLTAGE, frames.READ_CURRENT, frames.READ_TEMPERATURE)
        )
        self._shaft_rad: float | None = None
        self._torque_wanted = False
        self._position_due = False
        self._reading_due = False
        self._reading_s = -math.inf

        self._voltage_v: float | None = None
        self._current_a: float | None = None
        self._temperature_c: float | None = None

    def restart(self) -> None:
        """Forget the readings: the line is a new one."""
        self._voltage_v = self._current_a = self._temperature_c = None

    def note_silence(self) -> None:
        """Forget the readings: they grow old."""
        self._voltage_v = self._current_a = self._temperature_c = None

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Take the position to be set, and whether the servo shall be steered at all."""
        self._shaft_rad = shaft_rad
        self._torque_wanted = torque_on
        self._pace.note_command(now_s)
        self._position_due = self._reading_due = True

    def condition(self, *, answered: bool) -> tuple[DeviceState, str]:
        """The state: nothing but silence can be wrong."""
        if not answered:
            return DeviceState.STARTING, f"no answer from servo id {self.device_id}"
        return DeviceState.RUNNING, "" if self._torque_wanted else "not steered; this servo cannot release its motor"

    def answers(self, reply: frames.Reply, request: Request) -> bool:
        """Return whether the reply has the code that belongs to the request's."""
        return reply.code == frames.REPLY_OF[request.code]

    def take_answer(self, _request: Request, reply: frames.Reply, asked_s: float, *, sure: bool) -> Answer:  # noqa: ARG002 - the code says what it is
        """Keep a reading; the feedback goes with each angle, or with each reading while there are no angles."""
        shaft_rad = None
        if reply.code == frames.POSITION_REPLY:
            value = shaft_rad = reply.shaft_rad()
        elif reply.code == frames.VOLTAGE_REPLY:
            value = self._voltage_v = reply.voltage_v()
        elif reply.code == frames.CURRENT_REPLY:
            value = self._current_a = reply.current_a()
        else:
            value = self._temperature_c = reply.temperature_c()
        complete = reply.code == frames.POSITION_REPLY or not self._torque_wanted
        return Answer(impossible=value is None, feedback=self._feedback(shaft_rad, asked_s) if complete else None)

    def _feedback(self, shaft_rad: float | None, asked_s: float) -> RudderFeedback:
        return RudderFeedback(
            t_s=asked_s,
            shaft_rad=shaft_rad,
            temperature_c=self._temperature_c,
            voltage_v=self._voltage_v,
            current_a=self._current_a,
            torque_on=True if self._torque_wanted else None,
        )

    def next_request(self, now_s: float) -> Request | None:
        """Return the position when it is due, else a reading that does not hold up the next one."""
        if self._position_due and self._torque_wanted and self._shaft_rad is not None:
            return Request(frames.SET_POSITION, frames.set_position(self.device_id, self._shaft_rad))
        if (self._reading_due and self._pace.is_early(now_s)) or self._pace.is_overdue(now_s - self._reading_s):
            return self._readings[0]
        return None

    def needs_prompt_io(self) -> bool:
        """Return whether the position or a reading is due."""
        return (self._position_due and self._torque_wanted) or self._reading_due

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request is on its way."""
        if request.code == frames.SET_POSITION:
            self._position_due = False
        else:
            self._readings.rotate(-1)
            self._reading_due = False
            self._reading_s = now_s

    def note_lost(self, request: Request) -> None:
        """Do nothing: the next command repeats the position, and the readings come round."""


def volz_rudder(line: ByteLine, options: VolzOptions) -> ServoDriver[Request, frames.Reply]:
    """Make the driver of a Volz servo on a line."""
    timeout_s = reply_timeout_s(line.baud, LONGEST_EXCHANGE_BYTES)
    return ServoDriver(line, VolzServo(options), reply_timeout_s=timeout_s)
