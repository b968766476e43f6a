"""What a link by messages is told unasked: the report at its interval, and another mode or arming soon."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.telemetry.streams import HIGH_LATENCY

_CHANGES, _CHANGES_HZ = 6, 1.0 / 1800.0  # told at once, and in the long run: who changes to and fro costs no more
_NEVER_S = 1e9
_MINUTE_S = 60.0


class SatelliteReports:
    """Makes HIGH_LATENCY2 due on links by messages."""

    def __init__(self, context: LinkContext) -> None:
        """Take what knows the state and the peers."""
        self._context = context
        self._changes = TokenBucket(_CHANGES, _CHANGES_HZ)
        self._told: tuple[int, bool] | None = None

    def handlers(self) -> Mapping[int, Handler]:
        """Return that nothing is handled here."""
        return {}

    def update(self, now_s: float) -> None:
        """Make a report due when she does something else, and keep the interval that is wanted."""
        peers = [peer for peer in self._context.peers if peer.by_message]
        snapshot = self._context.snapshot
        if not peers or snapshot is None:
            return
        interval_s = self._context.request_handler.parameters()["SBD_REPORT_MIN"] * _MINUTE_S or _NEVER_S
        state = (int(snapshot.mode), snapshot.armed)
        changed = state != self._told and (self._told is None or self._changes.spend_one(now_s))
        for peer in peers:
            if peer.streams.interval_us(HIGH_LATENCY) != round(interval_s * 1e6):
                peer.streams.set_high_latency(interval_s, now_s)
            if changed:
                peer.streams.make_due(HIGH_LATENCY, now_s)
        if changed:
            self._told = state
