"""Access rights of received frames, which are checked before any other code reads the frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum
from typing import NamedTuple

from firmware_py.link.signing import SIGNED_FLAG, Signing
from firmware_py.link.wire.dialect import Message
from firmware_py.link.wire.frames import Frame
from firmware_py.link.wire.transport import Transport
from firmware_py.link.wire.urls import LinkClass, LinkOptions, Policy

_MAVLINK2 = 0xFD
SETUP_SIGNING = 256
RADIO_STATUS = 109
_COMMAND_INT, _COMMAND_LONG, _FILE_TRANSFER = 75, 76, 110
_MAX_MARKED_FRAMES = 16  # from the satellite link, not yet admitted


class Permission(IntEnum):
    """Rights of a frame."""

    NONE = 0  # ignored
    READER = 1  # may request data
    COMMANDER = 2  # may request changes


class AdmittedFrame(NamedTuple):
    """Frame with its rights."""

    frame: Frame
    permission: Permission
    is_verified: bool  # signed with the boat's key


class Gate:
    """Determines the rights of the frames of all links."""

    def __init__(self, signing: Signing) -> None:
        """Store the signing state."""
        self._signing = signing
        self._signed_frames: deque[bytes] = deque(maxlen=_MAX_MARKED_FRAMES)
        self.accepts_mavlink1 = True  # MAVLink 1 frames cannot be signed
        self.refused_frames = 0  # number of ignored frames
        self.false_signatures = 0  # of them, number with a wrong signature

    @property
    def late_frames(self) -> int:
        """Number of frames with the correct key and an old timestamp: replayed, or from a slow clock."""
        return self._signing.late_frames

    @property
    def has_key(self) -> bool:
        """Whether a signing key is set."""
        return self._signing.has_key

    def mark_signed(self, frame: bytes) -> None:
        """Accept the next copy of this frame from a satellite link as signed: its message had a valid HMAC."""
        self._signed_frames.append(frame)

    def is_owner(self, options: LinkOptions, *, is_verified: bool) -> bool:
        """Return whether a sender counts as the owner: it signs, its link is trusted, or there is no key."""
        return is_verified or options.trusted or not self.has_key

    def admit(self, frames: Iterable[Frame], options: LinkOptions, *, line: bool) -> list[AdmittedFrame]:
        """Return the frames with rights; `line`: whether they were received on a line, which may have a modem."""
        admitted = []
        for frame in frames:
            is_verified = self._verify(frame.data, options)
            if frame.number == RADIO_STATUS and is_verified is None:
                # The modem of a line sends it and has no key. A network has no modem, so it is ignored there.
                if not line:
                    continue
                permission = Permission.READER if self._accepts_version(frame.data) else Permission.NONE
            else:
                permission = self._permission(frame, options, is_verified=is_verified)
            if permission is Permission.NONE:
                self.refused_frames += 1
            else:
                admitted.append(AdmittedFrame(frame, permission, bool(is_verified)))
        return admitted

    def _accepts_version(self, data: bytes) -> bool:
        return self.accepts_mavlink1 or data[0] == _MAVLINK2

    def _verify(self, data: bytes, options: LinkOptions) -> bool | None:
        """Return whether the signature of a frame is valid; None for an unsigned frame, or without a key.

        A frame from a satellite link that `mark_signed` has marked is valid, also without a key.
        """
        if options.link_class is LinkClass.MESSAGES and data in self._signed_frames:
            self._signed_frames.remove(data)
            return True
        if not self.has_key or data[0] != _MAVLINK2 or not data[2] & SIGNED_FLAG:
            return None
        return self._signing.verify(data)

    def _permission(self, frame: Frame, options: LinkOptions, *, is_verified: bool | None) -> Permission:
        data = frame.data
        if not self._accepts_version(data):
            return Permission.NONE
        system = data[5 if data[0] == _MAVLINK2 else 3]
        is_allowed = options.systems is None or system in options.systems
        max_permission = Permission.COMMANDER if is_allowed else Permission.READER
        if frame.number == SETUP_SIGNING and options.trusted:
            return max_permission
        if is_verified is None:
            return min(max_permission, self.unsigned_permission(options))
        if not is_verified:
            self.false_signatures += 1
            return Permission.NONE
        return max_permission

    def unsigned_permission(self, options: LinkOptions) -> Permission:
        """Return the maximum rights of an unsigned frame."""
        policy = options.policy
        if self._signing.problem and not options.trusted:
            return Permission.NONE  # the loss of the key must not open the link
        if policy is Policy.AUTO:
            policy = Policy.SIGNED_COMMANDS if self.has_key and not options.trusted else Policy.OPEN
        return _UNSIGNED_PERMISSION[policy]


def is_open_to_anyone(gate: Gate, transport: Transport) -> bool:
    """Return whether any sender on another computer can command over a transport without a key."""
    options = transport.options
    return transport.is_exposed and not options.trusted and gate.unsigned_permission(options) is Permission.COMMANDER


_UNSIGNED_PERMISSION: Mapping[Policy, Permission] = {
    Policy.OPEN: Permission.COMMANDER,
    Policy.SIGNED_COMMANDS: Permission.READER,
    Policy.SIGNED_ONLY: Permission.NONE,
}

# Messages that only request data for their sender. All others are commands.
READING_MESSAGES = frozenset(
    {
        0,  # HEARTBEAT
        4,  # PING
        20,  # PARAM_REQUEST_READ
        21,  # PARAM_REQUEST_LIST
        37,  # MISSION_REQUEST_PARTIAL_LIST
        40,  # MISSION_REQUEST
        43,  # MISSION_REQUEST_LIST
        47,  # MISSION_ACK
        51,  # MISSION_REQUEST_INT
        66,  # REQUEST_DATA_STREAM
        RADIO_STATUS,
        111,  # TIMESYNC
        117,  # LOG_REQUEST_LIST
        119,  # LOG_REQUEST_DATA
        122,  # LOG_REQUEST_END
        320,  # PARAM_EXT_REQUEST_READ
        321,  # PARAM_EXT_REQUEST_LIST
    }
)
# MAVLink FTP: none, terminate and reset sessions, list, open and read, checksum, burst, list with times.
_READING_OPCODES = frozenset({0, 1, 2, 3, 4, 5, 14, 15, 16})
_OPCODE_INDEX = 3  # of the byte with the opcode, in the payload of file transfer


def make_reading_test(reading_commands: frozenset[int]) -> Callable[[int, Message], bool]:
    """Return a function that decides whether a message only requests data; `reading_commands` are such commands."""

    def only_reads(number: int, message: Message) -> bool:
        if number in (_COMMAND_INT, _COMMAND_LONG):
            return message.command in reading_commands
        if number == _FILE_TRANSFER:
            return message.payload[_OPCODE_INDEX] in _READING_OPCODES
        return number in READING_MESSAGES

    return only_reads
