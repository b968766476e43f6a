"""One correspondent on one transport."""

from __future__ import annotations

import math
from collections.abc import Iterable

from firmware_py.common.link_status import PeerStatus
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.telemetry.statustext import TextLimiter
from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.ways import Way
from firmware_py.link.wire.frames import Frame, Splitter, VersionHeard
from firmware_py.link.wire.outbox import BulkShare, Outbox, Priority, RadioPace, Sealer
from firmware_py.link.wire.transport import Address, Transport, usual_class
from firmware_py.link.wire.urls import LinkClass

# What goes to who may not be where he says he is, in bytes for each that came from there: whoever forges an address
# draws less than ten times of what he spends.
_CREDIT = 8
LATELY_S = 3.0  # stations send a heartbeat each second
DENIALS = 20  # answered at once to who has no right to what he asks
DENIALS_HZ = 5.0  # and in the long run


class Peer:
    """A correspondent: the parser of its bytes, the queue to it, the rates it has asked for.

    One is proven when what is sent to its address is known to arrive: it was answered, and then spoke again, or its
    frames are signed. Until then it gets a few times the bytes that came from there and no more.
    """

    __slots__ = (
        "_radio_pace",
        "_unanswered_bytes",
        "_version",
        "address",
        "bulk",
        "denial_tokens",
        "extended_rows_due",
        "ground_station_s",
        "heard_s",
        "heartbeat_s",
        "introduced",
        "last_frame_s",
        "link_class",
        "notices",
        "outbox",
        "parameter_list_row",
        "parameter_rows_due",
        "rest_follows",
        "splitter",
        "streams",
        "told_version",
        "transport",
        "verified",
        "way",
    )

    def __init__(self, transport: Transport, address: Address, sealer: Sealer, now_s: float) -> None:
        """Start with nothing heard and the rates of the transport's class."""
        self.transport = transport
        self.address = address
        datagrams = transport.datagrams
        self.way = Way((transport, transport.host(address)) if datagrams else (transport, address), now_s)
        self.splitter = Splitter(transport.byte_rate)
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate, sealer)
        self.link_class = usual_class(transport)
        self.streams = Streams(self.link_class, now_s)
        self.notices = TextLimiter()
        self.denial_tokens = TokenBucket(DENIALS, DENIALS_HZ)
        self.parameter_list_row: int | None = None  # the next row of the parameter list it gets
        self.parameter_rows_due: dict[int, None] = {}  # rows of the parameter table that it is owed, in order
        self.extended_rows_due: dict[int, None] = {}  # and those by PARAM_EXT
        self.bulk = BulkShare(transport.byte_rate)
        self._radio_pace = RadioPace(transport.byte_rate)
        self._version = VersionHeard()
        self.last_frame_s = now_s  # a valid frame came from it, or it was taken up
        self.heard_s: float | None = None  # its latest valid frame
        self.ground_station_s: float | None = None  # its latest heartbeat of a ground station
        self.heartbeat_s = -math.inf  # it was sent one while it had no place
        self.introduced = False  # it was sent what must come before the heartbeat of an armed boat
        self.told_version = False  # that it is answered in MAVLink 1
        self.rest_follows = False  # the next bytes are of a datagram of which a part was looked at
        self.verified = False  # it has signed a frame with the boat's key
        self._unanswered_bytes = 0  # sent to it when it was doubted

    @property
    def quiet(self) -> bool:
        """Whether it gets only what it has asked for: a satellite's bytes are paid for one by one."""
        return self.link_class is LinkClass.SATELLITE or self.by_message

    @property
    def by_message(self) -> bool:
        """Whether reports and warnings go there unasked, and each is paid for."""
        return self.link_class is LinkClass.MESSAGES

    @property
    def routes(self) -> bool:
        """Whether what others say to one another passes over its link."""
        route = self.transport.options.route
        if self.link_class is LinkClass.MESSAGES:
            return False
        return self.link_class is LinkClass.FAST if route is None else route

    @property
    def proven(self) -> bool:
        """Whether what is sent to its address is known to arrive there."""
        return self.outbox.credit_bytes is None

    def succeed(self, other: Peer) -> None:
        """Take the place of one that its station has left: what it has asked for is sent here from now on."""
        self.streams, self.introduced, self.ground_station_s = other.streams, other.introduced, other.ground_station_s
        self.parameter_list_row = other.parameter_list_row
        self.parameter_rows_due, self.extended_rows_due = other.parameter_rows_due, other.extended_rows_due

    def status(self, now_s: float, *, has_place: bool) -> PeerStatus:
        """Return how the correspondence with it fares."""
        host = self.transport.host(self.address)
        where = ":".join(map(str, self.address)) if isinstance(self.address, tuple) else str(host)
        return PeerStatus(
            address=where if isinstance(host, str) else self.transport.name,
            ground_station=self.ground_station_s is not None,
            has_place=has_place,
            signs=self.verified,
            heard_age_s=None if self.heard_s is None else now_s - self.heard_s,
            sent_bytes=self.outbox.sent_bytes,
            dropped=self.outbox.dropped,
            rejected=self.splitter.rejected,
        )

    def bulk_frames(self, frame_bytes: int, now_s: float) -> int:
        """Return how many frames of a long transfer may be queued now; none to one who may be elsewhere."""
        return self.bulk.frames(frame_bytes, self.outbox.waiting(Priority.REPLY), now_s) if self.proven else 0

    def note_version(self, frames: Iterable[Frame], now_s: float) -> None:
        """Answer in MAVLink 1 who goes on in it though she was there to be heard; by satellite nobody can tell."""
        if self.outbox.sent_bytes and not self.quiet:
            self._version.hear(frames, now_s)
            self.outbox.first_version = self._version.only_first

    def keep_pace(self, free_percent: int, now_s: float) -> None:
        """Take how much of its buffer a modem in the line has free."""
        self._radio_pace.hear(free_percent, now_s)
        self._pace(now_s)

    def forget_silent_radio(self, now_s: float) -> None:
        """Send as fast as the line carries again where there is no modem any more."""
        if self._radio_pace.forget(now_s):
            self._pace(now_s)

    def _pace(self, now_s: float) -> None:
        self.outbox.pace(self._radio_pace.share, now_s)
        self.bulk.pace(self._radio_pace.share, now_s)

    def may_be_new(self, now_s: float) -> bool:
        """Whether the next heartbeat may be the first one that somebody there sees."""
        return not self.introduced or self.heard_s is None or now_s - self.heard_s > LATELY_S

    def doubt(self) -> None:
        """Take it for one who may not be where he says he is."""
        self.outbox.credit_bytes = 0
        self._unanswered_bytes = self.outbox.sent_bytes

    def hear(self, count_bytes: int, now_s: float) -> bool:
        """Note that frames came from it, in so many bytes; return whether that proves it."""
        self.heard_s = self.last_frame_s = now_s
        if self.outbox.credit_bytes is None:
            return True
        answered = self.quiet or self.outbox.sent_bytes > self._unanswered_bytes
        if self.verified or (answered and not self.rest_follows):
            return True
        self.outbox.credit_bytes += _CREDIT * count_bytes
        return False
