"""The skeleton of a rudder driver: any servo that answers each frame it is sent, on a half-duplex bus.

The skeleton has what no protocol changes: one exchange at a time, the goal as soon as the
bus is free, replies that come late, the cable that comes and goes, silence, the counters and
the feedback that waits for the loop. The servo's own part, a `Servo`, knows frames and
registers, and neither reads nor writes: it is asked what to send next and is given what was
answered.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Generic, Protocol, TypeVar

import msgspec

from firmware_py.actuator.half_duplex import LONGEST_REPLY_TIMEOUT_S, HalfDuplex
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand, RudderFeedback

FEEDBACK_KEPT = 8


class Frame(Protocol):
    """A request of a servo's own kind."""

    @property
    def frame(self) -> bytes:
        """The bytes to write."""


RequestT = TypeVar("RequestT", bound=Frame)
ReplyT = TypeVar("ReplyT")
ReplyT_co = TypeVar("ReplyT_co", covariant=True)


class Answer(msgspec.Struct, frozen=True):
    """What a reply came to: `impossible` counts values that cannot be."""

    obeyed: bool = True
    impossible: int = 0
    feedback: RudderFeedback | None = None


class ReplyParser(Protocol[ReplyT_co]):
    """Finds the replies in a stream of any bytes."""

    @property
    def rejected(self) -> int:
        """How many looked like replies and were damaged."""

    def clear(self) -> None:
        """Forget the bytes of an unfinished reply."""

    def feed(self, data: bytes) -> Sequence[ReplyT_co]:
        """Take bytes as they arrived and return the replies that they complete."""


class Servo(Protocol[RequestT, ReplyT]):
    """The servo's own part of a driver."""

    @property
    def device_id(self) -> int:
        """The number of the servo on its bus."""

    @property
    def parser(self) -> ReplyParser[ReplyT]:
        """What finds its replies."""

    def restart(self) -> None:
        """Forget what was known of the servo: its line is a new one."""

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Take what the shaft shall do; None before any angle is known."""

    def next_request(self, now_s: float) -> RequestT | None:
        """Return what to send now, None when nothing is due; called while the bus is free."""

    def needs_prompt_io(self) -> bool:
        """Return whether something waits for the bus, and so for the reply to what was asked."""

    def note_sent(self, request: RequestT, now_s: float) -> None:
        """Note that the line has taken a request."""

    def note_lost(self, request: RequestT) -> None:
        """Note that the reply to a request is given up; it may still come."""

    def note_silence(self) -> None:
        """Note that the servo has stopped answering; called again while it is silent."""

    def answers(self, reply: ReplyT, request: RequestT) -> bool:
        """Return whether a reply can be that of the request: it may be an earlier one's, or another device's."""

    def take_answer(self, request: RequestT, reply: ReplyT, asked_s: float, *, sure: bool) -> Answer:
        """Take the reply to a request, which may have been given up; what it says is of when it was asked, or later.

        Not `sure`: it may also be that of a later request which it fits as well.
        """

    def condition(self, *, answered: bool) -> tuple[DeviceState, str]:
        """The state of a servo that is not silent, and the text beside it.

        `answered`: whether it has ever answered on this line.
        """


class ServoDriver(Generic[RequestT, ReplyT]):
    """An interfaces.Rudder around a servo."""

    def __init__(self, line: ByteLine, servo: Servo[RequestT, ReplyT], *, reply_timeout_s: float) -> None:
        """Take the line and the servo on it; ValueError for a timeout that is not above 0 and at most 1 s."""
        if not 0.0 < reply_timeout_s <= LONGEST_REPLY_TIMEOUT_S:
            raise ValueError(
                f"reply timeout {reply_timeout_s:g} s of a servo: allowed are 0 to {LONGEST_REPLY_TIMEOUT_S:g} s"
            )
        self._line = line
        self._servo = servo
        self._bus: HalfDuplex[RequestT] = HalfDuplex(line, reply_timeout_s)
        self._feedback: deque[RudderFeedback] = deque(maxlen=FEEDBACK_KEPT)
        self._accepted = 0
        self._rejected = 0
        self._answered = False  # since the line was opened
        self._shaft_rad: float | None = None

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._line.fileno()

    def needs_prompt_io(self) -> bool:
        """Say whether a reply must be taken when it comes, because something is to be sent then."""
        return self._bus.outstanding is not None and self._servo.needs_prompt_io()

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the goal, at once when the bus is free; a goal that is not finite is refused and the last one kept."""
        if math.isfinite(command.shaft_rad):
            self._shaft_rad = command.shaft_rad
        else:
            self._rejected += 1
        self._notice_reopening()
        self._servo.command(self._shaft_rad, now_s, torque_on=command.torque_on)
        if self._bus.outstanding is not None:  # its reply may be there, not yet read
            self._read()
        self._send(now_s)

    def receive(self, now_s: float) -> None:
        """Take what has arrived and send the next request, at most one a call."""
        self._notice_reopening()
        self._read()
        self._send(now_s)

    def poll(self) -> Sequence[RudderFeedback]:
        """The feedback since the last poll, oldest first, at most FEEDBACK_KEPT."""
        feedback = tuple(self._feedback)
        self._feedback.clear()
        return feedback

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the servo and its counters at now_s."""
        state, text = self._condition(now_s)
        rejected = self._rejected + self._servo.parser.rejected
        return DeviceHealth(now_s, DeviceRole.RUDDER, state, self._accepted, rejected, text)

    def _condition(self, now_s: float) -> tuple[DeviceState, str]:
        if not self._line.connected:
            return DeviceState.ABSENT, f"{self._line.name} is away"
        if self._bus.is_silent(now_s):
            state = DeviceState.SILENT if self._answered else DeviceState.STARTING
            return state, f"no answer from servo id {self._servo.device_id}"
        return self._servo.condition(answered=self._answered)

    def _notice_reopening(self) -> None:
        if self._bus.notice_reopening():
            self._servo.parser.clear()
            self._servo.restart()
            self._answered = False

    def _read(self) -> None:
        data = self._line.read()
        for reply in self._servo.parser.feed(data) if data else ():
            answered = self._bus.take_answered(partial(self._servo.answers, reply))
            if answered is None:
                self._rejected += 1
                continue
            self._answered = True
            request, asked_s, sure, doubtful = answered
            answer = self._servo.take_answer(request, reply, asked_s, sure=sure)
            if doubtful is not None:
                self._servo.note_lost(doubtful)
            self._accepted += answer.obeyed
            self._rejected += answer.impossible + (not answer.obeyed)
            if answer.feedback is not None:
                self._feedback.append(answer.feedback)

    def _send(self, now_s: float) -> None:
        if not self._line.connected:
            return
        bus = self._bus
        if bus.outstanding is not None and (lost := bus.take_expired(now_s)) is not None:
            self._servo.note_lost(lost)
        if bus.is_silent(now_s):
            self._servo.note_silence()
        if bus.outstanding is None:
            request = self._servo.next_request(now_s)
            if request is not None and bus.ask(request.frame, request, now_s):
                self._servo.note_sent(request, now_s)
