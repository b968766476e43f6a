"""Sends the rows of the telemetry table that are due, and at once what has changed."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.reports import Snapshot
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peers import Peers
from firmware_py.link.telemetry import motion
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.streams import HIGH_LATENCY
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.frames import Packed
from firmware_py.link.wire.outbox import Priority

_HEARTBEAT, _HOME_POSITION, _CURRENT_MODE = 0, 242, 436
(_BEAT,) = ROWS_OF[_HEARTBEAT]

_CHANGES, _CHANGES_HZ = 6, 1.0 / 1800.0  # reports of mode changes by satellite: burst, and average
_NEVER_S = 1e9
_MINUTE_S = 60.0


class TelemetryPublisher:
    """Telemetry after a tick."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context."""
        self._context = context

    def report_changes(self, before: Snapshot | None, snapshot: Snapshot, peers: Peers, now_s: float) -> None:
        """Make changed messages due at once: mode and arming, all if the rates change; send a changed home."""
        if before is not None and bool(before.power_saving_level) != bool(snapshot.power_saving_level):
            for peer in peers:
                peer.streams.make_all_due(now_s)
        if before is None or (before.mode, before.armed) != (snapshot.mode, snapshot.armed):
            for peer in peers:
                peer.streams.make_due(_HEARTBEAT, now_s)
                peer.streams.make_due(_CURRENT_MODE, now_s)
        moved = before is None or before.home != snapshot.home
        if snapshot.home is None or not (moved or self._context.home_report_due):
            return
        telemetry = self._context.telemetry_context()
        if telemetry is not None:
            self._context.home_report_due = False
            self._context.send_all(motion.home_position(telemetry))
            self._context.send_all(motion.gps_global_origin(telemetry))
            for peer in peers:
                peer.streams.postpone(_HOME_POSITION, now_s)

    def send_due(self, peers: Peers, tick_s: float, now_s: float) -> None:
        """Queue the due rows of each peer, as far as its line has room."""
        due = [(peer, rows) for peer in peers if (rows := peer.streams.due(now_s, tick_s))]
        telemetry = self._context.telemetry_context() if due else None
        if telemetry is None:
            return
        saves = telemetry.snapshot.power_saving_level
        stretch = self._context.request_handler.parameters()["PWR_LNK_FACTOR"] if saves else 1.0
        packed_rows: dict[int, Packed | None] = {}  # every row is built and packed once for all peers
        for peer, rows in due:
            room_bytes = peer.outbox.room_bytes(now_s)
            for row in rows:
                if row not in packed_rows:
                    packed_rows[row] = self._pack(row, telemetry)
                packed, priority = packed_rows[row], TABLE[row].priority
                if packed is not None:
                    if priority is not Priority.URGENT:
                        room_bytes -= peer.outbox.size_of(packed)
                        if room_bytes < 0.0:
                            # The rest stays due, and the longest due goes first next time.
                            continue
                    if row == _BEAT:
                        self._context.introduce(peer)
                    peer.outbox.push(packed, priority)
                # Without heartbeats every ground station would report a lost link.
                peer.streams.mark_sent(row, now_s, 1.0 if priority is Priority.URGENT else stretch)

    def _pack(self, row: int, telemetry: TelemetryContext) -> Packed | None:
        message = TABLE[row].build(telemetry)
        return None if message is None else self._context.codec.pack(message)


class SatelliteReports:
    """Makes HIGH_LATENCY2 due on links by message: at its interval, and after a change of mode or arming."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context."""
        self._context = context
        self._changes = TokenBucket(_CHANGES, _CHANGES_HZ)
        self._reported_state: tuple[int, bool] | None = None

    def handlers(self) -> Mapping[int, Handler]:
        """Return no handlers."""
        return {}

    def update(self, now_s: float) -> None:
        """Make a report due after a change of mode or arming, and set its interval by parameter."""
        peers = [peer for peer in self._context.peers if peer.by_message]
        snapshot = self._context.snapshot
        if not peers or snapshot is None:
            return
        interval_s = self._context.request_handler.parameters()["SBD_REPORT_MIN"] * _MINUTE_S or _NEVER_S
        state = (int(snapshot.mode), snapshot.armed)
        changed = state != self._reported_state and (self._reported_state is None or self._changes.spend_one(now_s))
        for peer in peers:
            if peer.streams.interval_us(HIGH_LATENCY) != round(interval_s * 1e6):
                peer.streams.set_high_latency(interval_s, now_s)
            if changed:
                peer.streams.make_due(HIGH_LATENCY, now_s)
        if changed:
            self._reported_state = state
