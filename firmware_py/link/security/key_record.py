"""The signing key as it is kept on disk: its text, and whether there is one, none, or one that was lost."""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import Enum
from hashlib import sha256

import msgspec

from firmware_py.common.records import Stored

KEY_BYTES = 32
MAX_STREAMS = 64
_TEXT = re.compile(rb"key ([0-9a-f]{64})\ntimestamp (\d{1,15})\n((?:stream \d{1,3} \d{1,3} \d{1,3} \d{1,15}\n)*)")

Stream = tuple[int, int, int]  # system, component, link


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
