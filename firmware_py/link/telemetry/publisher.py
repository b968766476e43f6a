"""Sending of telemetry: rows of the telemetry table when they are due, and some messages at a change."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.reports import Snapshot
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peers import Peers
from firmware_py.link.telemetry import motion
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.streams import HIGH_LATENCY2
from firmware_py.link.telemetry.table import ROWS_OF, TABLE
from firmware_py.link.wire.frames import Packed
from firmware_py.link.wire.outbox import Priority

_HEARTBEAT, _HOME_POSITION, _CURRENT_MODE = 0, 242, 436
(_HEARTBEAT_ROW,) = ROWS_OF[_HEARTBEAT]

_MAX_CHANGE_REPORTS, _CHANGE_REPORTS_HZ = 6, 1.0 / 1800.0  # of mode changes by satellite: burst and average rate
_NEVER_S = 1e9  # interval without reports
_MINUTE_S = 60.0


class TelemetryPublisher:
    """Sends telemetry after each tick."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context

    def report_changes(self, previous: Snapshot | None, snapshot: Snapshot, peers: Peers, now_s: float) -> None:
        """Send a changed home position, and make messages due that a change concerns.

        A change of mode or arming makes HEARTBEAT and CURRENT_MODE due, a change of power saving all messages.
        """
        if previous is not None and bool(previous.power_saving_level) != bool(snapshot.power_saving_level):
            for peer in peers:
                peer.streams.make_all_due(now_s)
        if previous is None or (previous.mode, previous.armed) != (snapshot.mode, snapshot.armed):
            for peer in peers:
                peer.streams.make_due(_HEARTBEAT, now_s)
                peer.streams.make_due(_CURRENT_MODE, now_s)
        home_changed = previous is None or previous.home != snapshot.home
        if snapshot.home is None or not (home_changed or self._context.home_report_due):
            return
        telemetry = self._context.telemetry_context()
        if telemetry is not None:
            self._context.home_report_due = False
            self._context.send_all(motion.home_position(telemetry))
            self._context.send_all(motion.gps_global_origin(telemetry))
            for peer in peers:
                peer.streams.postpone(_HOME_POSITION, now_s)

    def send_due(self, peers: Peers, tick_s: float, now_s: float) -> None:
        """Queue the due rows of each peer within the free capacity of its line, heartbeats in any case."""
        due_rows = [(peer, rows) for peer in peers if (rows := peer.streams.due_rows(now_s, tick_s))]
        telemetry = self._context.telemetry_context() if due_rows else None
        if telemetry is None:
            return
        saves_power = telemetry.snapshot.power_saving_level
        interval_factor = self._context.request_handler.parameters()["PWR_LNK_FACTOR"] if saves_power else 1.0
        packed_rows: dict[int, Packed | None] = {}  # each row is built and packed once for all peers
        for peer, rows in due_rows:
            available_bytes = peer.outbox.available_bytes(now_s)
            for row in rows:
                if row not in packed_rows:
                    packed_rows[row] = self._pack(row, telemetry)
                packed, priority = packed_rows[row], TABLE[row].priority
                if packed is not None:
                    if priority is not Priority.URGENT:
                        available_bytes -= peer.outbox.size_of(packed)
                        if available_bytes < 0.0:
                            continue  # the row remains due, and the oldest due row is sent first at the next tick
                    if row == _HEARTBEAT_ROW:
                        self._context.introduce(peer)
                    peer.outbox.push(packed, priority)
                # Heartbeats keep their interval, since a ground station reports a lost link without them.
                peer.streams.schedule_next(row, now_s, 1.0 if priority is Priority.URGENT else interval_factor)

    def _pack(self, row: int, telemetry: TelemetryContext) -> Packed | None:
        message = TABLE[row].build(telemetry)
        return None if message is None else self._context.codec.pack(message)


class SatelliteReports:
    """Schedules HIGH_LATENCY2 on links with paid messages: at its interval, and after a change of mode or arming."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context."""
        self._context = context
        self._changes = TokenBucket(_MAX_CHANGE_REPORTS, _CHANGE_REPORTS_HZ)
        self._reported_state: tuple[int, bool] | None = None

    def handlers(self) -> Mapping[int, Handler]:
        """Return no handlers: the service receives no messages."""
        return {}

    def update(self, now_s: float) -> None:
        """Make a report due after a change of mode or arming, and set its interval from the parameter."""
        peers = [peer for peer in self._context.peers if peer.has_paid_messages]
        snapshot = self._context.snapshot
        if not peers or snapshot is None:
            return
        interval_s = self._context.request_handler.parameters()["SBD_REPORT_MIN"] * _MINUTE_S or _NEVER_S
        state = (int(snapshot.mode), snapshot.armed)
        reports_change = state != self._reported_state and (
            self._reported_state is None or self._changes.spend_one(now_s)
        )
        for peer in peers:
            if peer.streams.interval_us(HIGH_LATENCY2) != round(interval_s * 1e6):
                peer.streams.set_high_latency(interval_s, now_s)
            if reports_change:
                peer.streams.make_due(HIGH_LATENCY2, now_s)
        if reports_change:
            self._reported_state = state
