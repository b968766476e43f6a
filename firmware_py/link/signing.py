"""MAVLink 2 signatures: the stored key, the boat's own timestamps, and the latest timestamp of each sender.

Source: https://mavlink.io/en/guide/message_signing.html. A signed frame ends with the id of its link, a timestamp of 48
bits in units of 10 us since 2015, and the first 48 bits of SHA-256 over the key and the frame before. The timestamp is
checked only if the signature is valid. Otherwise one forged frame with a future timestamp would lock out the sender.

The stored timestamps are up to 15 s ahead of those in use, so that they are valid after a sudden restart and are stored
rarely.
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
_STORED_TEXT = re.compile(
    rb"key ([0-9a-f]{64})\ntimestamp (\d{1,15})\n((?:stream \d{1,3} \d{1,3} \d{1,3} \d{1,15}\n)*)"
)

Stream = tuple[int, int, int]  # system, component, link

SIGNATURE_BYTES = 13  # link, timestamp, signature
SIGNED_FLAG = 0x01  # of the incompatibility flags
UNITS_HZ = 100_000  # units of the timestamp in a second
EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
MAX_NEW_STREAM_LAG = 60 * UNITS_HZ  # of the first timestamp of a stream behind the timestamp of the boat
# Later timestamps (from 2094) are refused; the range of 48 bits ends in 2104.
MAX_TIMESTAMP = 80 * 365 * 86_400 * UNITS_HZ
# The clock of the boat is used until 2084: if a wrong GPS time set it to the maximum, no timestamp would remain.
MAX_OWN_TIMESTAMP = MAX_TIMESTAMP - 10 * 365 * 86_400 * UNITS_HZ
STORED_LEAD = 15 * UNITS_HZ  # of the stored timestamps ahead of those in use
_TIMESTAMP_BYTES = 6


class KeyState(Enum):
    """State of the stored key."""

    ABSENT = "absent"  # never set, or removed
    PRESENT = "present"
    LOST = "lost"  # damaged or invalid


class KeyRecord(msgspec.Struct, frozen=True):
    """Key, a timestamp that is at least the latest used one, and the latest timestamp of each stream."""

    key: bytes
    timestamp: int
    streams: dict[Stream, int]


class KeyFinding(msgspec.Struct, frozen=True):
    """Result of reading the stored key."""

    state: KeyState
    record: KeyRecord | None = None
    problem: str = ""  # reason of the loss
    may_be_outdated: bool = False  # the newer slot is damaged


class NoVault:
    """Vault without storage."""

    def load(self) -> Stored:
        """Return an empty result."""
        return Stored()

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Do nothing."""

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call the function with False: nothing is stored."""
        call(False)


NO_VAULT = NoVault()


def find_key(stored: Stored) -> KeyFinding:
    """Evaluate the stored key. It is absent without a file or with an empty, undamaged file."""
    record = from_text(stored.content) if stored.content else None
    if record is not None:
        return KeyFinding(KeyState.PRESENT, record, may_be_outdated=bool(stored.damage))
    if stored.damage:
        return KeyFinding(KeyState.LOST, problem=stored.damage)
    if stored.content:
        return KeyFinding(KeyState.LOST, problem="what is stored is no signing key")
    return KeyFinding(KeyState.ABSENT)


def from_text(text: bytes) -> KeyRecord | None:
    """Parse the output of `to_text`; return None for other text."""
    match = _STORED_TEXT.fullmatch(text)
    if match is None or not any(key := bytes.fromhex(match[1].decode())):
        return None
    streams = {}
    for line in match[3].splitlines()[:MAX_STREAMS]:
        system, component, link, timestamp = (int(word) for word in line.split()[1:])
        streams[(system, component, link)] = timestamp
    return KeyRecord(key, int(match[2]), streams)


def to_text(record: KeyRecord) -> bytes:
    """Encode a key record as the text that is stored."""
    lines = [f"key {record.key.hex()}", f"timestamp {record.timestamp}"]
    lines += [f"stream {system} {component} {link} {timestamp}"
              for (system, component, link), timestamp in record.streams.items()]  # fmt: skip
    return ("\n".join(lines) + "\n").encode()


def key_of_passphrase(passphrase: str) -> bytes:
    """Return the key that MAVProxy, Mission Planner and QGroundControl derive from a passphrase."""
    return sha256(passphrase.encode()).digest()


class Save(Protocol):
    """Function that stores the state in the background; `both_slots` also overwrites the former state."""

    def __call__(self, content: bytes, *, both_slots: bool = False) -> None:
        """Store the content."""


def signature(key: bytes, covered: bytes) -> bytes:
    """Return the 6 bytes of the signature of a frame; `covered` is the frame up to and including the timestamp."""
    return sha256(key + covered).digest()[:6]


def timestamp_of(utc_s: float) -> int:
    """Convert a time to a timestamp; 0 for NaN and for a time before 2015 or after MAX_OWN_TIMESTAMP."""
    units = (utc_s - EPOCH_S) * UNITS_HZ
    return int(max(0.0, units)) if units <= MAX_OWN_TIMESTAMP else 0


class LinkSealer:
    """Signs the frames of one link; implements outbox.Sealer."""

    __slots__ = ("_link", "_signing")

    def __init__(self, signing: Signing, link: int) -> None:
        """Store the signing state and the id of the link."""
        self._signing = signing
        self._link = link & 0xFF

    @property
    def overhead_bytes(self) -> int:
        """Bytes that a signature adds to a frame; 0 without a key."""
        return SIGNATURE_BYTES if self._signing.has_key else 0

    def seal(self, packed: Packed, sequence: int) -> bytes:
        """Return the signed frame with this sequence number."""
        return self._signing.seal(packed, sequence, self._link)


class Signing:
    """Signs sent frames and verifies received frames, if a key is set.

    `problem` is the reason why the key was lost; empty if it was not.
    """

    def __init__(self, utc_s: Callable[[], float], save: Save) -> None:
        """Store the clock and the function that stores the state on disk."""
        self._utc_s = utc_s
        self._save = save
        self._key: bytes | None = None
        self._timestamp = 0  # latest used, or received with a valid signature
        self._streams: dict[Stream, int] = {}  # latest timestamp of each stream
        self._stored_timestamp = 0
        self._stored_streams: dict[Stream, int] = {}
        self._is_removed = False  # since the start
        self.problem = ""
        self.late_frames = 0  # frames with the right key and an old timestamp

    @property
    def has_key(self) -> bool:
        """Whether a key is set."""
        return self._key is not None

    # ------------------------------------------------------------------ the key

    def restore(self, stored: Stored) -> KeyState:
        """Restore the stored state; return the state of the key."""
        finding = find_key(stored)
        self.problem = finding.problem
        if (record := finding.record) is not None:
            self._key = record.key
            self._timestamp = self._stored_timestamp = min(record.timestamp, MAX_TIMESTAMP)
            if finding.may_be_outdated:  # a stream may be missing; a new one must not start with an old timestamp
                self._timestamp = min(self._timestamp + MAX_NEW_STREAM_LAG, MAX_TIMESTAMP)
            self._streams = {stream: min(latest, MAX_TIMESTAMP) for stream, latest in record.streams.items()}
            self._stored_streams = dict(self._streams)
        return finding.state

    def restore_late(self, stored: Stored) -> bool:
        """Restore the state of a disk that is available late.

        If a key was set or removed since the start, store the present state instead and return False.
        """
        if self._key is not None:
            self._store(STORED_LEAD, both_slots=True)
        elif self._is_removed:
            self.remove_key()
        else:
            self.restore(stored)
            return True
        return False

    def set_key(self, key: bytes, timestamp: int) -> bool:
        """Set a key and its first timestamp; return False if they are invalid."""
        if len(key) != KEY_BYTES or not any(key) or not 0 <= timestamp <= MAX_TIMESTAMP:
            return False
        if key == self._key:
            self._timestamp = max(self._timestamp, timestamp)
        else:
            # Frames with a new key were not received before, so none can be replayed.
            self._key = key
            self._streams = {}
            self._timestamp = timestamp
        self.problem = ""
        self._store(STORED_LEAD, both_slots=True)
        return True

    def remove_key(self) -> None:
        """Remove the key."""
        self._key = None
        self._is_removed = True
        self._streams = {}
        self.problem = ""
        self._save(b"", both_slots=True)

    def store_exactly(self) -> None:
        """Store the timestamps in use at an orderly end, so that the next run continues without a gap."""
        if self._key is not None:
            self._store(0)

    # ------------------------------------------------------------------ out

    def seal(self, packed: Packed, sequence: int, link: int) -> bytes:
        """Return the signed frame with this sequence number; raise ValueError without a key."""
        if self._key is None:
            raise ValueError("there is no key to sign with")
        self._timestamp = max(timestamp_of(self._utc_s()), self._timestamp + 1)
        self._store_if_due()
        frame = packed.frame
        body = bytes((frame[1], SIGNED_FLAG, frame[3], sequence)) + frame[5:-2]
        signature_block = link.to_bytes(1, "little") + self._timestamp.to_bytes(_TIMESTAMP_BYTES, "little")
        covered = frame[:1] + body + checksum(body, packed.seed).to_bytes(2, "little") + signature_block
        return covered + signature(self._key, covered)

    def compute_hmac(self, covered: bytes) -> bytes | None:
        """Return the HMAC-SHA256 of a satellite message; None without a key."""
        return None if self._key is None else digest(self._key, covered, "sha256")

    # ------------------------------------------------------------------ in

    def verify(self, frame: bytes) -> bool:
        """Return whether a signed MAVLink 2 frame has the correct key and a new timestamp in its stream."""
        if self._key is None or not compare_digest(signature(self._key, frame[:-6]), frame[-6:]):
            return False
        timestamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], frame[-13])
        latest = self._streams.get(stream)
        if timestamp > MAX_TIMESTAMP:
            return False
        if latest is None:
            if timestamp < max(timestamp_of(self._utc_s()), self._timestamp) - MAX_NEW_STREAM_LAG:
                self.late_frames += 1
                return False
            self._remove_oldest_stream()
        elif timestamp <= latest:
            self.late_frames += 1
            return False
        self._streams[stream] = timestamp
        self._timestamp = max(self._timestamp, timestamp)
        self._store_if_due(stream)
        return True

    def _remove_oldest_stream(self) -> None:
        """Remove the stream with the oldest timestamp if the number is at its maximum."""
        if len(self._streams) >= MAX_STREAMS:
            oldest = min(self._streams, key=self._streams.__getitem__)
            del self._streams[oldest]

    # ------------------------------------------------------------------ storage

    def _store_if_due(self, stream: Stream | None = None) -> None:
        """Store the timestamps when half of the lead of the stored ones is used."""
        lead = self._stored_timestamp - self._timestamp
        if stream is not None:
            lead = min(lead, self._stored_streams.get(stream, 0) - self._streams[stream])
        if lead < STORED_LEAD // 2:
            self._store(STORED_LEAD)

    def _store(self, lead: int, *, both_slots: bool = False) -> None:
        if self._key is None:
            return
        self._stored_timestamp = self._timestamp + lead
        self._stored_streams = {stream: timestamp + lead for stream, timestamp in self._streams.items()}
        self._save(to_text(KeyRecord(self._key, self._stored_timestamp, self._stored_streams)), both_slots=both_slots)
