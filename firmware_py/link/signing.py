"""MAVLink 2 signatures: the stored key, the boat's own timestamps, and the latest timestamp of each sender.

Source: https://mavlink.io/en/guide/message_signing.html. A signed frame ends with the id of its link, a timestamp of 48
bits in units of 10 us since 2015, and the first 48 bits of SHA-256 over the key and the frame before. The timestamp is
checked only if the signature is valid: otherwise one forged frame from the far future would lock out the true sender.

Timestamps survive a restart, also a sudden one: the stored ones are always a little ahead of those in use, so that they
are written only now and then.
"""

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
LATEST = 80 * 365 * 86_400 * UNITS_HZ  # a later timestamp (2094) is refused; 48 bits end ten years later
# The boat's own clock is used up to 2084: if a false GPS set it to LATEST, no timestamp would be left.
OWN_LATEST = LATEST - 10 * 365 * 86_400 * UNITS_HZ
AHEAD = 15 * UNITS_HZ  # of the stored timestamps before those in use
_TIMESTAMP_BYTES = 6


class KeyState(Enum):
    """State of the stored key."""

    ABSENT = "absent"  # never set, or removed
    PRESENT = "present"
    LOST = "lost"  # damaged, or not a key


class KeyRecord(msgspec.Struct, frozen=True):
    """A key, a timestamp not older than any used with it, and the latest timestamp of each stream."""

    key: bytes
    timestamp: int
    streams: dict[Stream, int]


class KeyFinding(msgspec.Struct, frozen=True):
    """The result of reading the stored key; `problem`: why it was lost. `aged`: the record may be an older one."""

    state: KeyState
    record: KeyRecord | None = None
    problem: str = ""
    aged: bool = False


class NoVault:
    """A Vault that stores nothing."""

    def load(self) -> Stored:
        """Return an empty state."""
        return Stored()

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Do nothing."""

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Report a failure."""
        call(False)


NO_VAULT = NoVault()


def find_key(stored: Stored) -> KeyFinding:
    """Return the stored key: absent without a file or with an empty, undamaged one."""
    record = from_text(stored.content) if stored.content else None
    if record is not None:
        return KeyFinding(KeyState.PRESENT, record, aged=bool(stored.damage))
    if stored.damage:
        return KeyFinding(KeyState.LOST, problem=stored.damage)
    if stored.content:
        return KeyFinding(KeyState.LOST, problem="what is stored is no signing key")
    return KeyFinding(KeyState.ABSENT)


def from_text(text: bytes) -> KeyRecord | None:
    """Read the output of `to_text`; None for anything else."""
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
    """Return the key that MAVProxy, Mission Planner and QGroundControl derive from a passphrase."""
    return sha256(passphrase.encode()).digest()


class Save(Protocol):
    """Stores the state in the background; `both_slots`: so that nothing of the former state is left."""

    def __call__(self, content: bytes, *, both_slots: bool = False) -> None:
        """Store this in place of the former state."""


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
        """Take the id of this link."""
        self._signing = signing
        self._link = link & 0xFF

    @property
    def overhead_bytes(self) -> int:
        """Bytes that a signature adds to a frame; 0 without a key."""
        return SIGNATURE_BYTES if self._signing.active else 0

    def seal(self, packed: Packed, sequence: int) -> bytes:
        """Return the frame with this sequence number, signed."""
        return self._signing.seal(packed, sequence, self._link)


class Signing:
    """Signs frames that leave and verifies frames that are received; without a key it does neither.

    `problem` says why the key was lost; it is empty if it was not.
    """

    def __init__(self, utc_s: Callable[[], float], save: Save) -> None:
        """Take the clock, and what keeps the state on disk."""
        self._utc_s = utc_s
        self._save = save
        self._key: bytes | None = None
        self._timestamp = 0  # the latest that was used, or received with a valid signature
        self._streams: dict[Stream, int] = {}  # the latest of each
        self._stored = 0  # stored value for _timestamp
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
        """Restore the state of an earlier run."""
        finding = find_key(stored)
        self.problem = finding.problem
        if (record := finding.record) is not None:
            self._key = record.key
            self._timestamp = self._stored = min(record.timestamp, LATEST)
            if finding.aged:  # a stream may be missing; a new one must not start with an old timestamp
                self._timestamp = min(self._timestamp + TOLERANCE, LATEST)
            self._streams = {stream: min(latest, LATEST) for stream, latest in record.streams.items()}
            self._stored_streams = dict(self._streams)
        return finding.state

    def restore_late(self, stored: Stored) -> bool:
        """Restore the state of a disk that is available late; False if a key has been set or removed since.

        In that case the present state is stored.
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
        """Set a key and its first timestamp; False, without a change, if they are not valid."""
        if len(key) != KEY_BYTES or not any(key) or not 0 <= timestamp <= LATEST:
            return False
        if key == self._key:
            self._timestamp = max(self._timestamp, timestamp)
        else:
            # No frame with this key was ever received, so none can be replayed.
            self._key = key
            self._streams = {}
            self._timestamp = timestamp
        self.problem = ""
        self._store(AHEAD, both_slots=True)
        return True

    def remove_key(self) -> None:
        """Remove the key."""
        self._key = None
        self._removed = True
        self._streams = {}
        self.problem = ""
        self._save(b"", both_slots=True)

    def store_exactly(self) -> None:
        """Store the timestamps in use, before an orderly end, so that the next run starts without a gap."""
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
        """Return the HMAC-SHA256 of a message by satellite; None without a key."""
        return None if self._key is None else digest(self._key, covered, "sha256")

    # ------------------------------------------------------------------ in

    def verify(self, frame: bytes) -> bool:
        """Return whether a signed MAVLink 2 frame is valid: right key, and newer than all before on its stream."""
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
        """Remove the stream with the oldest timestamp: if it continues, it counts as a new one."""
        if len(self._streams) >= MAX_STREAMS:
            oldest = min(self._streams, key=self._streams.__getitem__)
            del self._streams[oldest]

    # ------------------------------------------------------------------ storage

    def _keep_ahead(self, stream: Stream | None = None) -> None:
        """Store again when half of the lead of the stored timestamps is used up."""
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
