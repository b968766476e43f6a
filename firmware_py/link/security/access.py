"""Who may do what: judged frame by frame, before anything else looks at one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum
from typing import NamedTuple

from firmware_py.link.security.signing import SIGNED_FLAG, Signing
from firmware_py.link.wire.dialect import Message
from firmware_py.link.wire.framing import Frame
from firmware_py.link.wire.url_options import LinkOptions, Policy

_MAVLINK2 = 0xFD
SETUP_SIGNING = 256
RADIO_STATUS = 109
_COMMAND_INT, _COMMAND_LONG, _FILE_TRANSFER = 75, 76, 110


class Standing(IntEnum):
    """What a frame may do."""

    NONE = 0  # as if it had not come
    READER = 1  # ask, but change nothing
    COMMANDER = 2


class Admitted(NamedTuple):
    """A frame and what it may do."""

    frame: Frame
    standing: Standing


class Gate:
    """Judges the frames of all links."""

    def __init__(self, signing: Signing) -> None:
        """Take what knows the key."""
        self._signing = signing
        self.mavlink1 = True  # whether MAVLink 1 frames, which cannot be signed, are heard
        self.refused_frames = 0  # frames that were not heard at all
        self.false_signatures = 0  # those of them whose signature did not hold

    @property
    def late_frames(self) -> int:
        """Frames with the right key and an old timestamp: replayed, or from somebody who is behind."""
        return self._signing.late_frames

    def admit(self, frames: Iterable[Frame], options: LinkOptions) -> list[Admitted]:
        """Return those that are heard at all."""
        admitted = []
        for frame in frames:
            standing = self._standing(frame, options)
            if standing is Standing.NONE:
                self.refused_frames += 1
            else:
                admitted.append(Admitted(frame, standing))
        return admitted

    def _standing(self, frame: Frame, options: LinkOptions) -> Standing:
        data = frame.data
        second = data[0] == _MAVLINK2
        if not second and not self.mavlink1:
            return Standing.NONE
        if options.systems is not None and data[5 if second else 3] not in options.systems:
            most = Standing.READER
        else:
            most = Standing.COMMANDER
        if frame.number == SETUP_SIGNING and options.trusted:
            return most
        if self._signing.active and second and data[2] & SIGNED_FLAG:
            if self._signing.verify(data):
                return most
            self.false_signatures += 1
            return Standing.NONE
        if frame.number == RADIO_STATUS:  # from the modem, which knows no key
            return Standing.READER
        return min(most, self._unsigned(options))

    def _unsigned(self, options: LinkOptions) -> Standing:
        policy = options.policy
        if policy is Policy.AUTO:
            policy = Policy.SIGNED_COMMANDS if self._signing.active and not options.trusted else Policy.OPEN
        return _UNSIGNED[policy]


_UNSIGNED: Mapping[Policy, Standing] = {
    Policy.OPEN: Standing.COMMANDER,
    Policy.SIGNED_COMMANDS: Standing.READER,
    Policy.SIGNED_ONLY: Standing.NONE,
}

# Messages that change nothing but what is sent to their sender. What is not here is a command.
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
    }
)
# Of MAVLink FTP: none, terminate and reset sessions, list, open and read, checksum, burst, list with times.
_READING_OPCODES = frozenset({0, 1, 2, 3, 4, 5, 14, 15, 16})
_OPCODE = 3  # its place in the payload


def reads_only(reading_commands: frozenset[int]) -> Callable[[int, Message], bool]:
    """Return what tells whether a message changes nothing; `reading_commands` are the commands that only ask."""

    def judge(number: int, message: Message) -> bool:
        if number in (_COMMAND_INT, _COMMAND_LONG):
            return message.command in reading_commands
        if number == _FILE_TRANSFER:
            return message.payload[_OPCODE] in _READING_OPCODES
        return number in READING

    return judge
