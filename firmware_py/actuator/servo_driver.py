"""The common part of rudder drivers, for servos that reply to each frame on a half-duplex bus.

It handles the parts that do not depend on the protocol: one exchange at a time, the goal as soon as the bus is free,
late replies, reopened lines, silence, counters and queued feedback. The `Servo` of each protocol has the frames and
registers and does no I/O: it returns the next request and processes the replies.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Generic, Protocol, TypeVar

import msgspec

from firmware_py.actuator.half_duplex import MAX_REPLY_TIMEOUT_S, HalfDuplex
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand, RudderFeedback

MAX_FEEDBACK = 8


class FramedRequest(Protocol):
    """A request of a protocol."""

    @property
    def frame(self) -> bytes:
        """The bytes to write."""


RequestT = TypeVar("RequestT", bound=FramedRequest)
ReplyT = TypeVar("ReplyT")
ReplyT_co = TypeVar("ReplyT_co", covariant=True)


class ReplyResult(msgspec.Struct, frozen=True):
    """The result of a reply; `invalid_values` is the number of values out of range."""

    is_accepted: bool = True
    invalid_values: int = 0
    feedback: RudderFeedback | None = None


class ReplyParser(Protocol[ReplyT_co]):
    """Finds the replies in a stream of any bytes."""

    @property
    def rejected(self) -> int:
        """The number of damaged replies."""

    def clear(self) -> None:
        """Discard the bytes of an unfinished reply."""

    def feed(self, data: bytes) -> Sequence[ReplyT_co]:
        """Add bytes; return the completed replies."""


class Servo(Protocol[RequestT, ReplyT]):
    """The protocol-specific part of a driver."""

    @property
    def label(self) -> str:
        """The device in texts, as in "servo id 1"."""

    @property
    def parser(self) -> ReplyParser[ReplyT]:
        """The parser of its replies."""

    def restart(self) -> None:
        """Discard the state of the servo: its line was reopened."""

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Store the goal of the shaft; None before the first angle."""

    def next_request(self, now_s: float) -> RequestT | None:
        """Return the request to send now, None without one; called while the bus is free."""

    def needs_prompt_io(self) -> bool:
        """Return whether a request is due, which has to wait for the reply to the previous one."""

    def note_sent(self, request: RequestT, now_s: float) -> None:
        """Note that a request was sent."""

    def note_lost(self, request: RequestT) -> None:
        """Note that a request is given up; its reply may still arrive."""

    def note_silence(self) -> None:
        """Note that the servo has stopped replying; called repeatedly while it is silent."""

    def matches(self, reply: ReplyT, request: RequestT) -> bool:
        """Return whether a reply matches the request; it may belong to an earlier request or another device."""

    def process_reply(self, request: RequestT, reply: ReplyT, sent_s: float, *, is_certain: bool) -> ReplyResult:
        """Process the reply to a request, which may have been given up; its values are from `sent_s` or later.

        Not `is_certain`: the reply also matches a later request.
        """

    def condition(self, *, has_replied: bool) -> tuple[DeviceState, str]:
        """Return the state of a servo that is not silent, and its text.

        `has_replied`: whether it has replied since the line was opened.
        """


class ServoDriver(Generic[RequestT, ReplyT]):
    """An interfaces.Rudder for a servo."""

    def __init__(self, line: ByteLine, servo: Servo[RequestT, ReplyT], *, reply_timeout_s: float) -> None:
        """Store the line and the servo; raises ValueError for a timeout outside 0 to MAX_REPLY_TIMEOUT_S."""
        if not 0.0 < reply_timeout_s <= MAX_REPLY_TIMEOUT_S:
            raise ValueError(
                f"reply timeout {reply_timeout_s:g} s of a servo: allowed are 0 to {MAX_REPLY_TIMEOUT_S:g} s"
            )
        self._line = line
        self._servo = servo
        self._bus: HalfDuplex[RequestT] = HalfDuplex(line, reply_timeout_s)
        self._feedback: deque[RudderFeedback] = deque(maxlen=MAX_FEEDBACK)
        self._accepted = 0
        self._rejected = 0
        self._has_replied = False  # whether the servo has replied since the line was opened
        self._shaft_rad: float | None = None

    def fileno(self) -> int:
        """Return the descriptor to wait for, or -1."""
        return self._line.fileno()

    def needs_prompt_io(self) -> bool:
        """Return whether the next reply must be read at once, because another request is due."""
        return self._bus.pending_request is not None and self._servo.needs_prompt_io()

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the goal, at once if the bus is free; a goal that is not finite is rejected."""
        if math.isfinite(command.shaft_rad):
            self._shaft_rad = command.shaft_rad
        else:
            self._rejected += 1
        self._notice_reopening()
        self._servo.command(self._shaft_rad, now_s, torque_on=command.torque_on)
        if self._bus.pending_request is not None:  # its reply may have arrived
            self._read()
        self._send(now_s)

    def receive(self, now_s: float) -> None:
        """Process the received bytes and send at most one request."""
        self._notice_reopening()
        self._read()
        self._send(now_s)

    def poll(self) -> Sequence[RudderFeedback]:
        """Return the feedback since the last poll, oldest first, at most MAX_FEEDBACK."""
        feedback = tuple(self._feedback)
        self._feedback.clear()
        return feedback

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the servo and its counters at now_s."""
        state, text = self._condition(now_s)
        rejected = self._rejected + self._servo.parser.rejected
        return DeviceHealth(now_s, DeviceRole.RUDDER, state, self._accepted, rejected, text)

    def _condition(self, now_s: float) -> tuple[DeviceState, str]:
        if not self._line.connected:
            return DeviceState.ABSENT, f"port {self._line.name} not connected"
        if self._bus.is_silent(now_s):
            state = DeviceState.SILENT if self._has_replied else DeviceState.STARTING
            return state, f"no reply from {self._servo.label}"
        return self._servo.condition(has_replied=self._has_replied)

    def _notice_reopening(self) -> None:
        if self._bus.notice_reopening():
            self._servo.parser.clear()
            self._servo.restart()
            self._has_replied = False

    def _read(self) -> None:
        data = self._line.read()
        for reply in self._servo.parser.feed(data) if data else ():
            match = self._bus.match_reply(partial(self._servo.matches, reply))
            if match is None:
                self._rejected += 1
                continue
            self._has_replied = True
            request, sent_s, is_certain, uncertain = match
            result = self._servo.process_reply(request, reply, sent_s, is_certain=is_certain)
            if uncertain is not None:
                self._servo.note_lost(uncertain)
            self._accepted += result.is_accepted
            self._rejected += result.invalid_values + (not result.is_accepted)
            if result.feedback is not None:
                self._feedback.append(result.feedback)

    def _send(self, now_s: float) -> None:
        if not self._line.connected:
            return
        bus = self._bus
        if bus.pending_request is not None and (lost := bus.give_up_expired(now_s)) is not None:
            self._servo.note_lost(lost)
        if bus.is_silent(now_s):
            self._servo.note_silence()
        if bus.pending_request is None:
            request = self._servo.next_request(now_s)
            if request is not None and bus.send(request.frame, request, now_s):
                self._servo.note_sent(request, now_s)
