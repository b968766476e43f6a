"""Routing of messages between other systems over the boat's links, such as a companion computer and a ground station.

The route to a system and component is the peer from which it sent last. A message with an address is sent to that peer,
a broadcast to all. Only frames of senders that may command are routed, and only over fast links and links with
`route=1`. To avoid loops, a frame is routed only from the peer of its sender, and once.
"""

from __future__ import annotations

import re
import struct
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.access import AdmittedFrame, Permission
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Frame, Packed
from firmware_py.link.wire.outbox import Priority

MAX_ROUTES = 64  # to the components that sent last
ROUTE_TIMEOUT_S = 10.0  # silence of a sender after which its route may change to another peer
DUPLICATE_S = 3.0  # identical frames within this time are duplicates, since frames are numbered
MAX_STORED_FRAMES = 1024
MAX_BURST, MAX_RATE_HZ = 100, 200.0  # routed messages of all senders
_MAX_QUEUED = 32  # a peer with this number of queued messages receives no routed ones
_OVERLOAD = f"Routing overload: over {MAX_RATE_HZ:g} messages/s, some dropped"
_MAVLINK2, _HEADER2_BYTES, _HEADER1_BYTES = 0xFD, 10, 6

MavlinkAddress = tuple[int, int]  # system and component


class Router:
    """Learns routes, and forwards frames without change, with their signatures and sequence numbers."""

    def __init__(self, own: MavlinkAddress, peers: Iterable[Peer], notify: Callable[[str, float], None]) -> None:
        """Store the boat's own address, the active peers, and the function that notifies the operator."""
        self._own = own
        self._peers = peers
        self.notify = notify
        self._routes: OrderedDict[MavlinkAddress, tuple[Peer, float]] = OrderedDict()  # peer, time of the latest frame
        self._recent_frames: OrderedDict[int, float] = OrderedDict()  # time by the hash of the frame
        self._tokens = TokenBucket(MAX_BURST, MAX_RATE_HZ)

    def route(self, peer: Peer, frames: Iterable[AdmittedFrame], now_s: float) -> None:
        """Learn routes from the frames of a peer, and forward the frames to other peers."""
        if not peer.is_routed:
            return
        present = [other for other in self._peers if other.is_routed and other.is_proven]
        if len(present) < 2 or peer not in present:
            return
        for frame, permission, _ in frames:
            if permission is Permission.COMMANDER and self._learn_route(_source(frame.data), peer, present, now_s):
                self._forward(peer, frame, present, now_s)

    def _learn_route(self, source: MavlinkAddress, peer: Peer, present: Iterable[Peer], now_s: float) -> bool:
        """Learn the route to a sender; return False for the boat's own address and if another peer is the route."""
        if source == self._own:
            return False
        route, latest_s = self._routes.get(source, (peer, now_s))
        if route is not peer and route in present and now_s - latest_s < ROUTE_TIMEOUT_S:
            return False
        keep_latest(self._routes, source, (peer, now_s), MAX_ROUTES)
        return True

    def _forward(self, peer: Peer, frame: Frame, present: Iterable[Peer], now_s: float) -> None:
        target = _target(frame)
        if target == self._own:
            return
        recipients = [other for other in self._recipients(target, present) if other is not peer]
        if not recipients or self._is_duplicate(frame.data, now_s):
            return
        if not self._tokens.spend_one(now_s):
            self.notify(_OVERLOAD, now_s)
            return
        priority = Priority.REPLY if target[0] else Priority.TELEMETRY
        for other in recipients:
            if other.outbox.queued_count(priority) < _MAX_QUEUED:
                other.outbox.push(Packed(frame.data, b""), priority)

    def _recipients(self, target: MavlinkAddress, present: Iterable[Peer]) -> Iterable[Peer]:
        """Return the peers with a route to the target; all peers for a broadcast."""
        system, component = target
        if not system:
            return present
        peer_ids = {
            id(peer)
            for (route_system, route_component), (peer, _) in self._routes.items()
            if route_system == system and component in (0, route_component)
        }
        return [other for other in present if id(other) in peer_ids]

    def _is_duplicate(self, data: bytes, now_s: float) -> bool:
        recent = self._recent_frames
        while recent and (len(recent) >= MAX_STORED_FRAMES or now_s - next(iter(recent.values())) > DUPLICATE_S):
            recent.popitem(last=False)
        frame_hash = hash(data)
        if frame_hash in recent:
            return True
        recent[frame_hash] = now_s
        return False


def _source(data: bytes) -> MavlinkAddress:
    return (data[5], data[6]) if data[0] == _MAVLINK2 else (data[3], data[4])


def _target(frame: Frame) -> MavlinkAddress:
    """Return the target address of a frame; a missing system or component is 0, which means all."""
    data, offsets = frame.data, _TARGET_OFFSETS.get(frame.number, ())
    start = _HEADER2_BYTES if data[0] == _MAVLINK2 else _HEADER1_BYTES
    # MAVLink 2 omits trailing zeros of a payload.
    system, component = ((*(data[start + offset] if offset < data[1] else 0 for offset in offsets), 0, 0))[:2]
    return system, component


def _target_offsets(message_class: type) -> tuple[int, ...]:
    """Return the payload offsets of target system and component, if the message has them."""
    layout = re.findall(r"\d*[a-zA-Z]", message_class.unpacker.format.lstrip("<"))  # type: ignore[attr-defined]
    names, offset, offsets = message_class.ordered_fieldnames, 0, {}  # type: ignore[attr-defined]
    for name, field_format in zip(names, layout, strict=True):
        offsets[name] = offset
        offset += struct.calcsize(f"<{field_format}")
    system = offsets.get("target_system", offsets.get("target"))
    if system is None:
        return ()
    component = offsets.get("target_component")
    return (system,) if component is None else (system, component)


_TARGET_OFFSETS: Mapping[int, tuple[int, ...]] = {
    number: offsets
    for number, message_class in mavlink.mavlink_map.items()
    if (offsets := _target_offsets(message_class))
}
