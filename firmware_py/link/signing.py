"""Signing."""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import Enum
from hashlib import sha256
from hmac import compare_digest, digest
from typing import Protocol

import msgspec

from firmware_py.common.records import Stored
from firmware_py.link.wire.frames import Packed, checksum

KEY_BYTES = 32
MAX_STREAMS = 64
_TEXT = re.compile(rb"key ([0-9a-f]{64})\ntimestamp (\d{1,15})\n((?:stream \d{1,3} \d{1,3} \d{1,3} \d{1,15}\n)*)")

Stream = tuple[int, int, int]  # system, component, link

SIGNATURE_BYTES = 13  # link, timestamp, signature
SIGNED_FLAG = 0x01  # of the incompatibility flags
UNITS_HZ = 100_000  # units of the timestamp in a second
EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
TOLERANCE = 60 * UNITS_HZ  # a new stream may begin this far behind our own timestamp
LATEST = 80 * 365 * 86_400 * UNITS_HZ  # what shows more (2094) is not a clock; 48 bits end ten years later
# The boat's own clock counts to 2084: one set to what is heard last, by a false GPS, would shut her soon and for ever.
OWN_LATEST = LATEST - 10 * 365 * 86_400 * UNITS_HZ
AHEAD = 15 * UNITS_HZ  # so far ahead of what was used is what is on disk
_TIMESTAMP_BYTES = 6


class KeyState(Enum):
    """What there is of a key."""

    ABSENT = "absent"  # never set, or removed
    PRESENT = "present"
    LOST = "lost"  # something is there, and no key can be had of it


class KeyRecord(msgspec.Struct, frozen=True):
    """A key, a timestamp that is no older than any used with it, and the latest of each stream."""

    key: bytes
    timestamp: int
    streams: dict[Stream, int]


class KeyFinding(msgspec.Struct, frozen=True):
    """What is found of a key; `problem` says how it was lost. `aged`: the record may be an older one."""

    state: KeyState
    record: KeyRecord | None = None
    problem: str = ""
    aged: bool = False


class NoVault:
    """A Vault that keeps nothing."""

    def load(self) -> Stored:
        """Return that there is nothing."""
        return Stored()

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Forget it."""

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Say that it is not stored."""
        call(False)


NO_VAULT = NoVault()


def find_key(stored: Stored) -> KeyFinding:
    """Return what there is of a key: none where there is no file, or a whole empty one, and no damage."""
    record = from_text(stored.content) if stored.content else None
    if record is not None:
        return KeyFinding(KeyState.PRESENT, record, aged=bool(stored.damage))
    if stored.damage:
        return KeyFinding(KeyState.LOST, problem=stored.damage)
    if stored.content:
        return KeyFinding(KeyState.LOST, problem="what is stored is no signing key")
    return KeyFinding(KeyState.ABSENT)


def from_text(text: bytes) -> KeyRecord | None:
    """Read what `to_text` has written; None for anything else."""
    match = _TEXT.fullmatch(text)
    if match is None or not any(key := bytes.fromhex(match[1].decode())):
        return None
    streams = {}
    for line in match[3].splitlines()[:MAX_STREAMS]:
        system, component, link, timestamp = (int(word) for word in line.split()[1:])
        streams[(system, component, link)] = timestamp
    return KeyRecord(key, int(match[2]), streams)


def to_text(record: KeyRecord) -> bytes:
    """Write a key for the disk."""
    lines = [f"key {record.key.hex()}", f"timestamp {record.timestamp}"]
    lines += [f"stream {system} {component} {link} {timestamp}"
              for (system, component, link), timestamp in record.streams.items()]  # fmt: skip
    return ("\n".join(lines) + "\n").encode()


def key_of_passphrase(passphrase: str) -> bytes:
    """Return the key that MAVProxy, Mission Planner and QGroundControl make of a passphrase."""
    return sha256(passphrase.encode()).digest()


class Save(Protocol):
    """Keeps the state on disk, in the background; `both_slots`: so that nothing is left of what was kept before."""

    def __call__(self, content: bytes, *, both_slots: bool = False) -> None:
        """Keep this instead of what was kept."""


def signature(key: bytes, covered: bytes) -> bytes:
    """Return the signature of a frame up to and with its timestamp."""
    return sha256(key + covered).digest()[:6]


def timestamp_of(utc_s: float) -> int:
    """Return a time as a timestamp; 0, as if there were no clock, for one before 2015 or after OWN_LATEST, or NaN."""
    units = (utc_s - EPOCH_S) * UNITS_HZ
    return int(units) if 0.0 <= units <= OWN_LATEST else 0


class LinkSealer:
    """Signs what leaves on one link; fulfils outbox.Sealer."""

    __slots__ = ("_link", "_signing")

    def __init__(self, signing: Signing, link: int) -> None:
        """Take the number that tells this link from the others."""
        self._signing = signing
        self._link = link & 0xFF

    @property
    def overhead_bytes(self) -> int:
        """What a signature adds to a frame; 0 while there is no key."""
        return SIGNATURE_BYTES if self._signing.active else 0

    def seal(self, packed: Packed, sequence: int) -> bytes:
        """Return the frame with this sequence number, signed."""
        return self._signing.seal(packed, sequence, self._link)


class Signing:
    """Signs what leaves and judges what comes; without a key it does neither.

    `problem` says how a key was lost, and is empty when none was.
    """

    def __init__(self, utc_s: Callable[[], float], save: Save) -> None:
        """Take the clock, and what keeps the state on disk."""
        self._utc_s = utc_s
        self._save = save
        self._key: bytes | None = None
        self._timestamp = 0  # the latest that was used or, with a right signature, heard
        self._streams: dict[Stream, int] = {}  # the latest of each
        self._stored = 0  # what the disk has for _timestamp
        self._stored_streams: dict[Stream, int] = {}
        self._removed = False  # since the start
        self.problem = ""
        self.late_frames = 0  # frames with the right key and an old timestamp

    @property
    def active(self) -> bool:
        """Whether there is a key."""
        return self._key is not None

    # ------------------------------------------------------------------ the key

    def restore(self, stored: Stored) -> KeyState:
        """Take up the state of an earlier run."""
        finding = find_key(stored)
        self.problem = finding.problem
        if (record := finding.record) is not None:
            self._key = record.key
            self._timestamp = self._stored = min(record.timestamp, LATEST)
            if finding.aged:  # it may lack a stream: none may begin anew behind what was heard
                self._timestamp = min(self._timestamp + TOLERANCE, LATEST)
            self._streams = {stream: min(heard, LATEST) for stream, heard in record.streams.items()}
            self._stored_streams = dict(self._streams)
        return finding.state

    def take_up(self, stored: Stored) -> bool:
        """Take up what a disk holds that has come late; False when there is a key by now, or one was removed.

        The disk then gets what there is.
        """
        if self._key is not None:
            self._store(AHEAD, both_slots=True)
        elif self._removed:
            self.remove_key()
        else:
            self.restore(stored)
            return True
        return False

    def set_key(self, key: bytes, timestamp: int) -> bool:
        """Take a key and the timestamp to begin at; False, and nothing changed, for what is none."""
        if len(key) != KEY_BYTES or not any(key) or not 0 <= timestamp <= LATEST:
            return False
        if key == self._key:
            self._timestamp = max(self._timestamp, timestamp)
        else:
            # Nothing that was ever signed with this key has been heard: the past need not be guarded.
            self._key = key
            self._streams = {}
            self._timestamp = timestamp
        self.problem = ""
        self._store(AHEAD, both_slots=True)
        return True

    def remove_key(self) -> None:
        """Forget the key."""
        self._key = None
        self._removed = True
        self._streams = {}
        self.problem = ""
        self._save(b"", both_slots=True)

    def store_exactly(self) -> None:
        """Store what was used and no more, before an orderly end: the next run then need not wait for anything."""
        if self._key is not None:
            self._store(0)

    # ------------------------------------------------------------------ out

    def seal(self, packed: Packed, sequence: int, link: int) -> bytes:
        """Return the frame with this sequence number, signed; ValueError without a key."""
        if self._key is None:
            raise ValueError("there is no key to sign with")
        self._timestamp = max(timestamp_of(self._utc_s()), self._timestamp + 1)
        self._keep_ahead()
        frame = packed.frame
        body = bytes((frame[1], SIGNED_FLAG, frame[3], sequence)) + frame[5:-2]
        block = link.to_bytes(1, "little") + self._timestamp.to_bytes(_TIMESTAMP_BYTES, "little")
        covered = frame[:1] + body + checksum(body, packed.seed).to_bytes(2, "little") + block
        return covered + signature(self._key, covered)

    def code(self, covered: bytes) -> bytes | None:
        """Return the HMAC-SHA256 of what is no frame, by the key; None without one."""
        return None if self._key is None else digest(self._key, covered, "sha256")

    # ------------------------------------------------------------------ in

    def verify(self, frame: bytes) -> bool:
        """Return whether a signed MAVLink 2 frame holds: right key, and newer than all before it on its stream."""
        if self._key is None or not compare_digest(signature(self._key, frame[:-6]), frame[-6:]):
            return False
        timestamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], frame[-13])
        earlier = self._streams.get(stream)
        if timestamp > LATEST:
            return False
        if earlier is None:
            if timestamp < max(timestamp_of(self._utc_s()), self._timestamp) - TOLERANCE:
                self.late_frames += 1
                return False
            self._make_room()
        elif timestamp <= earlier:
            self.late_frames += 1
            return False
        self._streams[stream] = timestamp
        self._timestamp = max(self._timestamp, timestamp)
        self._keep_ahead(stream)
        return True

    def _make_room(self) -> None:
        """Forget the stream that is furthest behind: it would be a new one again, within the tolerance."""
        if len(self._streams) >= MAX_STREAMS:
            oldest = min(self._streams, key=self._streams.__getitem__)
            del self._streams[oldest]

    # ------------------------------------------------------------------ on disk

    def _keep_ahead(self, stream: Stream | None = None) -> None:
        """Store anew when half of what the disk is ahead has been used up."""
        behind = self._stored - self._timestamp
        if stream is not None:
            behind = min(behind, self._stored_streams.get(stream, 0) - self._streams[stream])
        if behind < AHEAD // 2:
            self._store(AHEAD)

    def _store(self, ahead: int, *, both_slots: bool = False) -> None:
        if self._key is None:
            return
        self._stored = self._timestamp + ahead
        self._stored_streams = {stream: timestamp + ahead for stream, timestamp in self._streams.items()}
        self._save(to_text(KeyRecord(self._key, self._stored, self._stored_streams)), both_slots=both_slots)
