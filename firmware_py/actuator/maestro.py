"""Driver of a hobby servo on a Pololu Maestro servo controller, compact protocol.

Source: Pololu Maestro Servo Controller User's Guide (0J40), sections 4.e (errors), 5.a (serial modes), 5.c to 5.e. A
command is a byte with bit 7 set and data bytes without it, with a CRC-7 at the end if the Maestro is set to require
one. A target is a pulse width in quarter microseconds; 0 ends the pulses. A reply has two bytes, low first, without
header and checksum.

* Every tick asks for the position of the channel and then sets the target. The position is the pulse width that the
  Maestro sends now: it is commanded, not measured, so the feedback has no angle.
* Once a second the driver sets the limits of speed and acceleration, which a Maestro forgets without power, and reads
  and clears the error register. After any error a Maestro moves its servos to their home positions; the next tick sets
  the target again.
* A channel without pulses, whose target was accepted before, shows that the Maestro has restarted, unless the error
  register explains it. This needs the home position "Off" of the channel, the factory setting.
* `AA`, device number, `21` is the same request in Pololu protocol. It begins every search, because its first byte sets
  the baud rate of a Maestro in the mode "UART, detect baud rate".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from firmware_py.actuator.half_duplex import ReadingWindow, reply_timeout_s
from firmware_py.actuator.pulse import PulseOptions, PulseScale
from firmware_py.actuator.servo_driver import ReplyResult, ServoDriver
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine, Rudder
from firmware_py.common.options import option
from firmware_py.common.records import DeviceState, RudderFeedback

SET_TARGET, SET_SPEED, SET_ACCELERATION, GET_POSITION, GET_ERRORS = 0x84, 0x87, 0x89, 0x90, 0xA1
POLOLU_PROTOCOL = 0xAA
MAX_EXCHANGE_BYTES = 16
REPLY_SIZE = 2
ERRORS_INTERVAL_S = 1.0
ERROR_HOLD_S = 10.0
MAX_POSITION_AGE_S = 1.5
QUARTERS_PER_US = 4
MIN_POSITION, MAX_POSITION = 64 * QUARTERS_PER_US, 3280 * QUARTERS_PER_US  # that a channel can be set to
MAX_ERRORS = 0x01FF
_CRC_POLYNOMIAL = 0x91  # x^7 + x^3 + 1, reflected, with the bit that is shifted out
_ERROR_TEXTS = (
    "serial signal error: wrong baud rate?",
    "serial overrun",
    "serial buffer full",
    "CRC error: check option crc",
    "serial protocol error: check option crc",
    "serial timeout",
    "script stack error",
    "script call stack error",
    "script counter error",
)


@dataclass(frozen=True, slots=True)
class MaestroOptions(PulseOptions):
    """Options of the vehicle file for a Maestro; raises ValueError."""

    channel: int = option("channel of the servo", default=0, minimum=0, maximum=23)
    device: int = option("device number, used to set the baud rate", default=12, minimum=0, maximum=127)
    crc: bool = option("whether the Maestro is set to require a CRC", default=False)
    speed: int = option("speed limit [0.25 us / 10 ms]; 0: none", default=0, minimum=0, maximum=16383)
    acceleration: int = option(
        "acceleration limit, in the unit of the Maestro; 0: none", default=0, minimum=0, maximum=255
    )


def crc7(data: bytes) -> int:
    """Return the CRC-7 of a command, 0 to 127."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value ^ _CRC_POLYNOMIAL if value & 1 else value) >> 1
    return value


class ReplyParser:
    """Divides the received bytes into replies of two bytes; a reply begins after each request."""

    __slots__ = ("_buffer", "rejected")

    def __init__(self) -> None:
        """Create it without bytes."""
        self._buffer = bytearray()
        self.rejected = 0

    @property
    def pending(self) -> int:
        """The number of bytes of an unfinished reply."""
        return len(self._buffer)

    def clear(self) -> None:
        """Discard the bytes of an unfinished reply."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[int]:
        """Add bytes; return the numbers in the completed replies."""
        buffer = self._buffer
        buffer += data
        end = len(buffer) - len(buffer) % REPLY_SIZE
        numbers = [buffer[start] | buffer[start + 1] << 8 for start in range(0, end, REPLY_SIZE)]
        del buffer[:end]
        return numbers


class Request(msgspec.Struct, frozen=True):
    """Bytes of a request; `target`: the one that it sets, in quarter microseconds; None: it reads the errors.

    Each request is an object of its own, because a reply belongs to the newest one only.
    """

    frame: bytes
    target: int | None = None
    is_search: bool = False


class MaestroServo:
    """A servo_driver.Servo; shaft angle 0 is the pulse width centre_us."""

    def __init__(self, options: MaestroOptions) -> None:
        """Start without a command."""
        self.label = "Maestro"
        self.parser = ReplyParser()
        self._options = options
        self._scale = PulseScale.of(options)
        self._window = ReadingWindow()
        self._search_frame = self._frame(POLOLU_PROTOCOL, options.device, GET_ERRORS & 0x7F)
        self._reading_frame = (
            self._frame(SET_SPEED, options.channel, *_low_and_high(options.speed))
            + self._frame(SET_ACCELERATION, options.channel, *_low_and_high(options.acceleration))
            + self._frame(GET_ERRORS)
        )
        self._shaft_rad: float | None = None
        self._torque_command = False
        self._is_target_due = False
        self._was_search = False
        self._last_reading_s = -math.inf
        self._newest: Request | None = None
        self._has_lost_reply = False  # since the last reply
        self._is_silent = False
        self._restarts = 0
        self._error_text = ""
        self._error_s = -math.inf
        self._now_s = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin a search: the line was reopened."""
        self._accepted_target: int | None = None  # the last one, in quarter microseconds; None: unknown
        self._position_s: float | None = None  # of the last reply to a target
        self._has_lost_target = False  # no pulses though a target was set; the errors will show why
        self._is_search_due = True

    def note_silence(self) -> None:
        """Search, alternating with the target: a Maestro of another device number replies only to the latter."""
        self._is_silent = True
        self._is_search_due = not self._was_search

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Store the angle and whether to send pulses."""
        self._shaft_rad, self._torque_command, self._now_s = shaft_rad, torque_on, now_s
        self._window.note_command(now_s)
        self._is_target_due = True

    def needs_prompt_io(self) -> bool:
        """Return whether the target is due."""
        return self._is_target_due

    def next_request(self, now_s: float) -> Request | None:
        """Return the search or the target if it is due, otherwise the reading of the errors."""
        if self._is_search_due:
            return Request(self._search_frame, is_search=True)
        if self._is_target_due:
            target = self._target()
            channel = self._options.channel
            frame = self._frame(GET_POSITION, channel) + self._frame(SET_TARGET, channel, *_low_and_high(target))
            return Request(frame, target)
        age_s = now_s - self._last_reading_s
        is_overdue = age_s >= ERRORS_INTERVAL_S and (self._window.is_early(now_s) or self._window.is_overdue(age_s))
        return Request(self._reading_frame) if self._has_lost_target or is_overdue else None

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request was sent; its reply begins with the next byte."""
        self.parser.clear()
        self._newest = request
        self._was_search = request.is_search
        if request.target is not None:
            self._is_target_due = False
        elif self._was_search:
            self._is_search_due = False
        else:
            self._last_reading_s = now_s

    def note_lost(self, _request: Request) -> None:
        """Note that replies may be late; the next command repeats the target, and the errors are read again."""
        self._has_lost_reply = True

    def matches(self, reply: int, request: Request) -> bool:
        """Return whether the request is the newest and the number possible: a pulse width or 0, or bits of errors.

        A late reply cannot be distinguished from that to the newest request. It has no effect that lasts.
        """
        if request is not self._newest:
            return False
        if request.target is None:
            return reply <= MAX_ERRORS
        return reply == 0 or MIN_POSITION <= reply <= MAX_POSITION

    def process_reply(self, request: Request, reply: int, sent_s: float, *, is_certain: bool) -> ReplyResult:  # noqa: ARG002 - only the newest request matches
        """Use a position, which is from before the target of the request, or the errors."""
        may_be_late = self._has_lost_reply and not self._is_silent
        self._has_lost_reply = self._is_silent = False
        if request.target is None:
            self._use_errors(reply, sent_s)
            return ReplyResult()
        self._position_s = sent_s
        if reply == 0 and self._accepted_target and not may_be_late:
            self._has_lost_target = True
        self._accepted_target = request.target
        return ReplyResult(
            feedback=RudderFeedback(sent_s, torque_on=request.target > 0, restarts=self._restarts),
        )

    def condition(self, *, has_replied: bool) -> tuple[DeviceState, str]:
        """Return the state; an error of the Maestro is only a text for ERROR_HOLD_S, and a hobby servo reports none."""
        if not has_replied:
            return DeviceState.STARTING, "no reply from the Maestro"
        if self._position_s is None or self._now_s - self._position_s > MAX_POSITION_AGE_S:
            state = DeviceState.STARTING if self._position_s is None else DeviceState.SILENT
            return state, "no position from the Maestro: wrong baud rate?"
        if self._now_s - self._error_s <= ERROR_HOLD_S:
            return DeviceState.RUNNING, self._error_text
        if not self._torque_command:
            return DeviceState.RUNNING, "no pulse; the servo is free"
        if self._shaft_rad is not None and self._scale.is_limited(self._shaft_rad):
            return DeviceState.RUNNING, "pulse limited by min_us or max_us"
        return DeviceState.RUNNING, ""

    def _target(self) -> int:
        if not self._torque_command or self._shaft_rad is None:
            return 0
        return round(QUARTERS_PER_US * self._scale.pulse_us(self._shaft_rad))

    def _use_errors(self, errors: int, sent_s: float) -> None:
        """Note an error; without one, pulses that have ended show a restart."""
        if errors:
            self._error_text = next(text for bit, text in enumerate(_ERROR_TEXTS) if errors >> bit & 1)
            self._error_s = sent_s
            self._accepted_target = None  # the servo may be at its home position until the next target
        elif self._has_lost_target:
            self._restarts += 1
        self._has_lost_target = False

    def _frame(self, *content: int) -> bytes:
        """Return a command with its CRC, if the Maestro requires one."""
        data = bytes(content)
        return data + bytes([crc7(data)]) if self._options.crc else data


def _low_and_high(number: int) -> tuple[int, int]:
    """Return bits 0 to 6 and bits 7 to 13."""
    return number & 0x7F, number >> 7 & 0x7F


def maestro_rudder(line: ByteLine, options: MaestroOptions) -> ServoDriver[Request, int]:
    """Return the driver of a servo on a Maestro."""
    return ServoDriver(line, MaestroServo(options), reply_timeout_s=reply_timeout_s(line.baud, MAX_EXCHANGE_BYTES))


DRIVER: Driver[Rudder] = Driver(
    interface=INTERFACE,
    device="hobby servo on a Pololu Maestro; angle not measured",
    options=MaestroOptions,
    make=maestro_rudder,
    writes=True,
)
