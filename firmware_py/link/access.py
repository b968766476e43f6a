"""Access rights: each received frame is judged before any other code sees it."""

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
_VOUCHED = 16  # frames on their way from the satellite link to the gate


class Permission(IntEnum):
    """Rights of a frame."""

    NONE = 0  # ignored
    READER = 1  # may request data, but change nothing
    COMMANDER = 2


class Admitted(NamedTuple):
    """A frame and its rights; `verified`: it is signed with the boat's key."""

    frame: Frame
    permission: Permission
    verified: bool


class Gate:
    """Judges the frames of all links."""

    def __init__(self, signing: Signing) -> None:
        """Take the signing state."""
        self._signing = signing
        self._vouched: deque[bytes] = deque(maxlen=_VOUCHED)
        self.mavlink1 = True  # whether MAVLink 1 frames, which cannot be signed, are accepted
        self.refused_frames = 0  # frames that were ignored
        self.false_signatures = 0  # of them, those with a wrong signature

    @property
    def late_frames(self) -> int:
        """Number of frames with the right key and an old timestamp: replayed, or from a slow clock."""
        return self._signing.late_frames

    @property
    def keyed(self) -> bool:
        """Whether a signing key is set."""
        return self._signing.active

    def vouch(self, frame: bytes) -> None:
        """Accept the next copy of this frame from a satellite link as signed: its message carried a valid code."""
        self._vouched.append(frame)

    def knows(self, options: LinkOptions, *, verified: bool) -> bool:
        """Return whether a sender belongs to the owner, as far as that can be verified; without a key any may."""
        return verified or options.trusted or not self.keyed

    def admit(self, frames: Iterable[Frame], options: LinkOptions, *, line: bool) -> list[Admitted]:
        """Return the frames that are not ignored; `line`: they came over a line, which may have a modem in it."""
        admitted = []
        for frame in frames:
            verified = self._verified(frame.data, options)
            if frame.number == RADIO_STATUS and verified is None:
                # From the modem of a line, which has no key. On a network there is no modem: ignored.
                if not line:
                    continue
                permission = Permission.READER if self._accepts_version(frame.data) else Permission.NONE
            else:
                permission = self._permission(frame, options, verified=verified)
            if permission is Permission.NONE:
                self.refused_frames += 1
            else:
                admitted.append(Admitted(frame, permission, bool(verified)))
        return admitted

    def _accepts_version(self, data: bytes) -> bool:
        return self.mavlink1 or data[0] == _MAVLINK2

    def _verified(self, data: bytes, options: LinkOptions) -> bool | None:
        """Return whether the signature of a frame is valid; None for a frame without one, or without a key."""
        if options.link_class is LinkClass.MESSAGES and data in self._vouched:
            self._vouched.remove(data)
            return True
        if not self.keyed or data[0] != _MAVLINK2 or not data[2] & SIGNED_FLAG:
            return None
        return self._signing.verify(data)

    def _permission(self, frame: Frame, options: LinkOptions, *, verified: bool | None) -> Permission:
        data = frame.data
        if not self._accepts_version(data):
            return Permission.NONE
        second = data[0] == _MAVLINK2
        if options.systems is not None and data[5 if second else 3] not in options.systems:
            most = Permission.READER
        else:
            most = Permission.COMMANDER
        if frame.number == SETUP_SIGNING and options.trusted:
            return most
        if verified is None:
            return min(most, self.unsigned(options))
        if not verified:
            self.false_signatures += 1
            return Permission.NONE
        return most

    def unsigned(self, options: LinkOptions) -> Permission:
        """Return the maximum rights of a frame without a signature."""
        policy = options.policy
        if self._signing.problem and not options.trusted:
            return Permission.NONE  # a lost key does not open the link
        if policy is Policy.AUTO:
            policy = Policy.SIGNED_COMMANDS if self.keyed and not options.trusted else Policy.OPEN
        return _UNSIGNED[policy]


def is_open_to_anyone(gate: Gate, transport: Transport) -> bool:
    """Return whether any sender that reaches a transport from another computer can command without a key."""
    options = transport.options
    return transport.is_exposed and not options.trusted and gate.unsigned(options) is Permission.COMMANDER


_UNSIGNED: Mapping[Policy, Permission] = {
    Policy.OPEN: Permission.COMMANDER,
    Policy.SIGNED_COMMANDS: Permission.READER,
    Policy.SIGNED_ONLY: Permission.NONE,
}

# Messages that change nothing except what is sent to their sender. All others are commands.
READING = frozenset(
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
# Of MAVLink FTP: none, terminate and reset sessions, list, open and read, checksum, burst, list with times.
_READING_OPCODES = frozenset({0, 1, 2, 3, 4, 5, 14, 15, 16})
_OPCODE = 3  # its index in the payload


def reads_only(reading_commands: frozenset[int]) -> Callable[[int, Message], bool]:
    """Return a function that decides whether a message changes nothing; `reading_commands` only request data."""

    def judge(number: int, message: Message) -> bool:
        if number in (_COMMAND_INT, _COMMAND_LONG):
            return message.command in reading_commands
        if number == _FILE_TRANSFER:
            return message.payload[_OPCODE] in _READING_OPCODES
        return number in READING

    return judge
