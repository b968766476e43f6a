"""Queue of the reports of other vessels between two polls, with a limited size."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

from firmware_py.common.vessels import VesselIdentity, VesselReport, merge

MAX_REPORTS_PER_TICK = 40
MAX_PENDING_REPORTS = 256


class VesselQueue:
    """Holds the newest report of each kind and vessel, in the order in which its first pending report arrived.

    Pending identities of one vessel are merged.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._pending: dict[tuple[type[VesselReport], int], VesselReport] = {}

    def add(self, report: VesselReport) -> bool:
        """Add a report; return False if it is dropped because the queue is full."""
        key = (type(report), report.mmsi)
        if key not in self._pending and len(self._pending) >= MAX_PENDING_REPORTS:
            return False
        previous = self._pending.get(key)
        if isinstance(previous, VesselIdentity) and isinstance(report, VesselIdentity):
            self._pending[key] = merge(previous, report)
        else:
            self._pending[key] = report
        return True

    def take(self) -> Sequence[VesselReport]:
        """Return and remove the first reports, at most MAX_REPORTS_PER_TICK; positions first, as in the log."""
        if not self._pending:
            return ()
        keys = sorted(islice(self._pending, MAX_REPORTS_PER_TICK), key=lambda key: key[0] is VesselIdentity)
        return [self._pending.pop(key) for key in keys]
