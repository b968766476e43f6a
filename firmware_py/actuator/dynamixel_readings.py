"""Schedule of the telemetry and state readings of a Dynamixel, so that they do not delay the goal."""

from __future__ import annotations

import math
from collections import deque

from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel_configuration import Kind, Request, read_request
from firmware_py.actuator.half_duplex import ReadingWindow

SLOW_EVERY_S = 0.25  # state and watchdog alternate; both are read together with the goal at half this rate
MAX_COMBINED_LOSSES = 3  # consecutive; then the servo does not support reads of so many registers


class Readings:
    """Telemetry once per command, with or without a goal; state and watchdog alternating at a lower rate."""

    def __init__(self, device_id: int, combined_s: float) -> None:
        """Store the id of the servo and the duration of the combined read."""
        self._combined_s = combined_s
        self._combined_losses = 0  # consecutive losses
        self._telemetry = read_request(device_id, table.TELEMETRY)
        self._slow_requests = deque((read_request(device_id, table.STATE), read_request(device_id, table.WATCHDOG)))
        self._is_telemetry_due = False
        self._telemetry_s = -math.inf
        self._slow_s = -math.inf
        self._window = ReadingWindow()

    def note_command(self, now_s: float) -> None:
        """Note a new command."""
        self._window.note_command(now_s)
        self._is_telemetry_due = True

    def request_state(self) -> None:
        """Make the state the next slow reading, due at once."""
        self._slow_s = -math.inf
        if self._slow_requests[0].block is not table.STATE:
            self._slow_requests.rotate()

    def is_combined_due(self) -> bool:
        """Return whether to read state and watchdog with the goal: they are due, and there is enough time."""
        return self._is_slow_due() and self._window.early_s >= self._combined_s

    def note_combined_rejected(self) -> None:
        """Read state and watchdog separately from now on."""
        self._combined_s = math.inf

    def note_combined_lost(self) -> None:
        """Note a combined read without a reply; MAX_COMBINED_LOSSES in a row count as a rejection."""
        self._combined_losses += 1
        if self._combined_losses >= MAX_COMBINED_LOSSES:
            self.note_combined_rejected()

    def split_combined(self, combined: bytes) -> list[tuple[Request, bytes]]:
        """Return the requests of the slow readings with their part of the reply to the combined read."""
        self._combined_losses = 0
        return [
            (request, table.extract_block(combined, request.block))
            for request in self._slow_requests
            if request.block is not None
        ]

    def has_more_due(self) -> bool:
        """Return whether a reading will be due after the reply to the command."""
        return self._is_telemetry_due or self._is_slow_due()

    def _is_slow_due(self) -> bool:
        return self._window.early_end_s - self._slow_s >= SLOW_EVERY_S

    def next_request(self, now_s: float) -> Request | None:
        """Return the reading to send now."""
        is_early = self._window.is_early(now_s)
        if (self._is_telemetry_due and is_early) or self._window.is_overdue(now_s - self._telemetry_s):
            return self._telemetry
        slow_age_s = now_s - self._slow_s
        if slow_age_s >= SLOW_EVERY_S and (is_early or self._window.is_overdue(slow_age_s - SLOW_EVERY_S)):
            return self._slow_requests[0]
        return None

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request was sent."""
        if request is self._telemetry or request.kind is Kind.GOAL:  # which also reads telemetry
            self._is_telemetry_due = False
            self._telemetry_s = now_s
            if request.block is table.COMBINED:
                self._slow_s = now_s + SLOW_EVERY_S  # both were read, so the next one is due after two intervals
        elif request is self._slow_requests[0]:
            self._slow_requests.rotate()
            self._slow_s = now_s
