"""When a Dynamixel's telemetry and state are read, so that they never hold up the goal."""

from __future__ import annotations

import math
from collections import deque

from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel_upkeep import Kind, Request, read_request
from firmware_py.actuator.half_duplex import Pace

SLOW_EVERY_S = 0.25  # state and watchdog take turns, or both come with the goal at every other turn
WHOLE_TRIES = 3  # in a row: a servo that does not answer for so many registers is not asked for them again


class Readings:
    """Telemetry once a command, with the goal or without one; the state and the watchdog in turn at a slower rate."""

    def __init__(self, device_id: int, whole_s: float) -> None:
        """Take the id of the servo, and how long it takes to ask for all of it at once."""
        self._whole_s = whole_s
        self._whole_lost = 0  # in a row
        self._telemetry = read_request(device_id, table.TELEMETRY)
        self._slow = deque((read_request(device_id, table.STATE), read_request(device_id, table.WATCHDOG)))
        self._telemetry_due = False
        self._telemetry_s = -math.inf
        self._slow_s = -math.inf
        self._pace = Pace()

    def note_command(self, now_s: float) -> None:
        """Note that a command has come."""
        self._pace.note_command(now_s)
        self._telemetry_due = True

    def read_state_next(self) -> None:
        """Have the state read as soon as there is time."""
        self._slow_s = -math.inf
        if self._slow[0].block is not table.STATE:
            self._slow.rotate()

    def whole_due(self) -> bool:
        """Return whether state and watchdog are to be asked for with the goal: they are due, and there is time."""
        return self._slow_due() and self._pace.early_s >= self._whole_s

    def note_whole_refused(self) -> None:
        """Have state and watchdog read by themselves from now on."""
        self._whole_s = math.inf

    def note_whole_lost(self) -> None:
        """Note that all was asked for and nothing came: three times in a row is a refusal."""
        self._whole_lost += 1
        if self._whole_lost >= WHOLE_TRIES:
            self.note_whole_refused()

    def slow_parts(self, whole: bytes) -> list[tuple[Request, bytes]]:
        """Return the slow readings, and what each would have been answered, of the answer to all."""
        self._whole_lost = 0
        return [(request, table.part_of(whole, request.block)) for request in self._slow if request.block is not None]

    def more_due(self) -> bool:
        """Return whether there will be one to begin as soon as the reply to the command is there."""
        return self._telemetry_due or self._slow_due()

    def _slow_due(self) -> bool:
        return self._pace.early_end_s - self._slow_s >= SLOW_EVERY_S

    def next_request(self, now_s: float) -> Request | None:
        """Return the reading to begin now."""
        early = self._pace.is_early(now_s)
        if (self._telemetry_due and early) or self._pace.is_overdue(now_s - self._telemetry_s):
            return self._telemetry
        slow_age_s = now_s - self._slow_s
        if slow_age_s >= SLOW_EVERY_S and (early or self._pace.is_overdue(slow_age_s - SLOW_EVERY_S)):
            return self._slow[0]
        return None

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a reading has begun."""
        if request is self._telemetry or request.kind is Kind.GOAL:  # which reads it, too
            self._telemetry_due = False
            self._telemetry_s = now_s
            if request.block is table.WHOLE:
                self._slow_s = now_s + SLOW_EVERY_S
        elif request is self._slow[0]:
            self._slow.rotate()
            self._slow_s = now_s
