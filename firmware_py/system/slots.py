"""Two slots (files) for each name, written alternately and in place, so that the newest valid version is unchanged.

A write changes neither the directory nor the file size; on a journalling file system such changes cost ten times as
much as the data. A slot, `NAME.0` or `NAME.1`, starts with a line of sequence number, length and checksum; the content
follows unchanged. An intentionally empty slot has a special first line.

A slot of 0 bytes counts as damaged, because memory cards leave lost files empty. The slots of a secret must belong to
the user of the process. A withdrawn version of a secret counts as damaged, so that a lost secret is distinguished from
one that was never set.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import zlib
from enum import Enum
from pathlib import Path

import msgspec

from firmware_py.common.records import Stored
from firmware_py.files.reading import UNUSABLE, open_regular, read_regular
from firmware_py.files.writing import FILE_MODE, PRIVATE_MODE, set_aside, sync_directory, write_atomically
from firmware_py.system.state_export import KEY_SUFFIX, RECORD_SUFFIX, BrokenExportError, max_slot_bytes, pending_import

SLOTS = (0, 1)
# Earlier versions stored the same records as text with this suffix. Their files stay unchanged for a roll-back.
_EARLIER_SUFFIX = ".state"
_ASIDE_SUFFIX = ".old"
BLOCK_BYTES = 4096  # the size of a slot is a multiple
_HEAD = re.compile(rb"# rambler state (\d{1,18}) (\d{1,12}) ([0-9a-f]{8})\n")
_EMPTY = b"# rambler empty\n"


class SlotCondition(Enum):
    """The condition of a slot."""

    WHOLE = "is whole"
    EMPTY = "is empty"
    ABSENT = "is missing"
    DAMAGED = "is damaged"
    UNREADABLE = "cannot be read"


class _Slot(msgspec.Struct, frozen=True):
    """One slot: number, condition, sequence number and content of its version."""

    number: int
    condition: SlotCondition
    sequence: int = 0
    content: bytes = b""
    reason: str = ""


def read_content(directory: Path, name: str) -> bytes | None:
    """Return the newest valid version of a name, or None; safe while an autopilot is writing."""
    return examine(directory, name).content


def examine(directory: Path, name: str, owner_uid: int | None = None) -> Stored:
    """Return the newest valid version of a name and a description of damaged, unreadable and missing slots.

    `owner_uid` is the required owner of the slots of a secret. The content of a pending import has priority. A record
    is not read if there is a slot of an earlier version of this program: that version has run since, or may run again
    after a roll-back.
    """
    with contextlib.suppress(BrokenExportError, OSError):  # reported by the store
        import_ = pending_import(directory)
        if import_ is not None and name in import_.files:
            return Stored(import_.content(name))
    for path in find_earlier_slots(directory, name):
        return Stored(damage=f"{path.name} is of another version")
    slots = _read_slots(directory, name, owner_uid)
    newest = _newest_of(slots)
    # After the second version, both slots exist.
    has_both_slots = newest is not None and newest.sequence > 1
    problems = [
        f"{name}.{slot.number} {slot.condition.value}{slot.reason and f' ({slot.reason})'}"
        for slot in slots
        if slot.condition in (SlotCondition.DAMAGED, SlotCondition.UNREADABLE)
        or (has_both_slots and slot.condition is SlotCondition.ABSENT)
    ]
    return Stored(None if newest is None else newest.content, ", ".join(problems))


def is_secret(name: str) -> bool:
    """Return whether only the owner may read the content of a name."""
    return Path(name).suffix == KEY_SUFFIX


def slot_path(directory: Path, name: str, slot: int) -> Path:
    """Return the path of a slot."""
    return directory / f"{name}.{slot}"


def earlier_name(name: str) -> str:
    """Return the name that earlier versions used for a record; empty for a text, which kept its name."""
    return f"{name.removesuffix(RECORD_SUFFIX)}{_EARLIER_SUFFIX}" if name.endswith(RECORD_SUFFIX) else ""


def find_earlier_slots(directory: Path, name: str) -> list[Path]:
    """Return the existing slots of a record that an earlier version wrote; none for a text."""
    earlier = earlier_name(name)
    paths = [slot_path(directory, earlier, slot) for slot in SLOTS] if earlier else []
    return [path for path in paths if os.path.lexists(path)]


def _read_slots(directory: Path, name: str, owner_uid: int | None) -> tuple[_Slot, ...]:
    max_bytes = max_slot_bytes(name)
    return tuple(_read_slot(slot_path(directory, name, slot), slot, max_bytes, owner_uid) for slot in SLOTS)


def _read_slot(path: Path, number: int, max_bytes: int, owner_uid: int | None) -> _Slot:
    try:
        wrong_uid = None if owner_uid in (None, (uid := path.lstat().st_uid)) else uid
        data = b"" if wrong_uid is not None else read_regular(path, max_bytes, follow_symlinks=False)
    except (FileNotFoundError, NotADirectoryError):  # the second is reported as an error of the directory
        return _Slot(number, SlotCondition.ABSENT)
    except OSError as error:
        return _Slot(number, SlotCondition.UNREADABLE, reason=str(error.strerror))
    if wrong_uid is not None:
        return _Slot(number, SlotCondition.UNREADABLE, reason=f"it belongs to user {wrong_uid}")
    if data.startswith(_EMPTY):
        return _Slot(number, SlotCondition.EMPTY)
    head = _HEAD.match(data)
    if head is not None:
        content = data[head.end() : head.end() + int(head[2])]
        if len(content) == int(head[2]) and _checksum(head[1], content) == head[3]:
            return _Slot(number, SlotCondition.WHOLE, int(head[1]), content)
    return _Slot(number, SlotCondition.DAMAGED)


def _newest_of(slots: tuple[_Slot, ...]) -> _Slot | None:
    whole_slots = [slot for slot in slots if slot.condition is SlotCondition.WHOLE]
    return max(whole_slots, key=lambda slot: slot.sequence, default=None)


def _checksum(sequence: bytes, content: bytes) -> bytes:
    return f"{zlib.crc32(content, zlib.crc32(sequence)):08x}".encode()


def _make_private(path: Path) -> None:
    """Make a slot readable only by the owner, before a secret is written; raises OSError.

    A file of another user is replaced atomically by an empty file, which counts as damaged.
    """
    try:
        status = path.lstat()
    except FileNotFoundError:
        return
    if stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid():
        path.chmod(PRIVATE_MODE)
        return
    if stat.S_ISDIR(status.st_mode):
        set_aside(path)
    write_atomically(path, b"", PRIVATE_MODE)


def _round_up_to_blocks(count: int) -> int:
    return -(-count // BLOCK_BYTES) * BLOCK_BYTES


class SlotWriter:
    """Writes versions. It remembers the newest slots and keeps the files open, which halves the time."""

    def __init__(self, directory: Path, private: frozenset[str]) -> None:
        """Store the directory and the names that only the owner may read."""
        self._directory = directory
        self._private = private
        self._newest_slots: dict[str, tuple[int, int]] = {}  # slot and sequence of the newest version on disk
        self._saved_names: set[str] = set()  # names that this writer has saved
        self._uncertain_slots: dict[str, int] = {}  # slots that may contain a valid version whose commit has failed
        self._files: dict[tuple[str, int], int] = {}
        self._has_new_file = False  # a file was created and its directory entry may not be on disk yet
        self.versions = 0
        self.written_bytes = 0  # in whole blocks

    def close(self) -> None:
        """Close the files."""
        for name, slot in tuple(self._files):
            self._close_slot(name, slot)

    def write(self, name: str, content: bytes) -> None:
        """Write a new version into the older slot and sync it.

        After an OSError the previous version is the newest again, unless `is_uncertain`.
        """
        try:
            self._newest_slots[name] = self._write_slot(name, content)
            del self._uncertain_slots[name]
            self._saved_names.add(name)
        except OSError:
            with contextlib.suppress(OSError):
                self.withdraw(name)
            for slot in SLOTS:
                self._close_slot(name, slot)
            raise

    def clear(self, name: str) -> None:
        """Empty both slots of a name that is not a secret; raises OSError."""
        for slot in SLOTS:
            if slot_path(self._directory, name, slot).exists():
                self._write_empty(name, slot)
        self._newest_slots.pop(name, None)

    def set_aside(self, name: str) -> None:
        """Rename the slots of a record that an earlier version wrote; raises OSError.

        A record that this version saved in a previous run is older than those slots, so it is cleared first.
        """
        paths = find_earlier_slots(self._directory, name)
        if not paths:
            return
        if name not in self._saved_names:
            self.clear(name)
        for path in paths:
            os.replace(path, f"{path}{_ASIDE_SUFFIX}")  # noqa: PTH105 - tests inject errors into calls of os
        sync_directory(self._directory)

    def is_uncertain(self, name: str) -> bool:
        """Return whether a version whose commit has failed may be read at the next start."""
        return name in self._uncertain_slots

    def withdraw(self, name: str) -> None:
        """Remove a version whose commit has failed; raises OSError."""
        slot = self._uncertain_slots.get(name)
        if slot is None:
            return
        try:
            self._write_empty(name, slot)
        except OSError:
            self._close_slot(name, slot)
            slot_path(self._directory, name, slot).unlink(missing_ok=True)
            sync_directory(self._directory)
        del self._uncertain_slots[name]

    def _write_empty(self, name: str, slot: int) -> None:
        descriptor, present_bytes = self._open_slot(name, slot)
        self._write_all(descriptor, self._empty_head(name).ljust(max(present_bytes, BLOCK_BYTES), b"\0"))
        os.fdatasync(descriptor)

    def _find_newest(self, name: str) -> tuple[int, int]:
        """Return slot and sequence number of the newest version, so that the other slot is written.

        Without a version, an unreadable slot is written.
        """
        slots = _read_slots(self._directory, name, os.geteuid() if name in self._private else None)
        for number in [slot.number for slot in slots if slot.condition is SlotCondition.DAMAGED]:
            if name not in self._private:
                self._close_slot(name, number)
                set_aside(slot_path(self._directory, name, number))  # for later inspection
        newest = _newest_of(slots)
        if newest is not None:
            # A killed process may have left the file and its directory entry in memory only.
            os.fdatasync(self._open_slot(name, newest.number)[0])
            self._has_new_file = True
            return newest.number, newest.sequence
        unreadable = [slot.number for slot in slots if slot.condition is SlotCondition.UNREADABLE]
        for slot in unreadable[1:]:
            self._write_empty(name, slot)  # otherwise its content would be used when it is readable again
        return (1 - unreadable[0] if unreadable else SLOTS[1]), 0

    def _write_slot(self, name: str, content: bytes) -> tuple[int, int]:
        """Write a version into the older slot; return slot and sequence number."""
        # It is not looked up again after a failure, because the failed version may appear to be the newest.
        newest = self._newest_slots.get(name)
        if newest is None:
            newest = self._newest_slots[name] = self._find_newest(name)
        slot, sequence = 1 - newest[0], newest[1] + 1
        sequence_text = b"%d" % sequence
        checksum = _checksum(sequence_text, content)
        data = b"# rambler state %s %d %s\n" % (sequence_text, len(content), checksum) + content
        size = _round_up_to_blocks(len(data))
        if size > max_slot_bytes(name):
            raise OSError(errno.EFBIG, "content too large")
        descriptor, present_bytes = self._open_slot(name, slot)
        if name in self._private:
            data = data.ljust(max(size, present_bytes), b"\0")  # overwrite the rest of a longer secret
        self._uncertain_slots[name] = slot
        if present_bytes < size:
            # Write bytes to allocate the space before it is needed.
            self._write_all(descriptor, self._empty_head(name).ljust(size, b"\0"))
        self.versions += 1
        self._write_all(descriptor, data)
        os.fdatasync(descriptor)
        if self._has_new_file:
            sync_directory(self._directory)
            self._has_new_file = False
        return slot, sequence

    def _write_all(self, descriptor: int, data: bytes) -> None:
        """Write data at the start of a file; raises OSError also if only a part could be written."""
        self.written_bytes += _round_up_to_blocks(len(data))
        if os.pwrite(descriptor, data, 0) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _open_slot(self, name: str, slot: int) -> tuple[int, int]:
        """Open a slot; return its descriptor and its size."""
        cached = self._files.get((name, slot))
        if cached is not None:
            status = os.fstat(cached)
            if status.st_nlink:
                return cached, status.st_size
            self._close_slot(name, slot)  # the file was removed or replaced
        path, mode = slot_path(self._directory, name, slot), PRIVATE_MODE if name in self._private else FILE_MODE
        if name in self._private:
            _make_private(path)
        self._has_new_file |= not path.exists()
        flags, max_bytes = os.O_RDWR | os.O_CREAT, max_slot_bytes(name)
        try:
            descriptor = open_regular(path, flags=flags, mode=mode, follow_symlinks=False, max_bytes=max_bytes)
        except OSError as error:
            if error.errno not in UNUSABLE:
                raise
            set_aside(path)
            descriptor = open_regular(path, flags=flags, mode=mode, follow_symlinks=False, max_bytes=max_bytes)
        self._files[name, slot] = descriptor
        return descriptor, os.fstat(descriptor).st_size

    def _empty_head(self, name: str) -> bytes:
        """Return the first line of an empty slot."""
        return b"" if name in self._private else _EMPTY

    def _close_slot(self, name: str, slot: int) -> None:
        descriptor = self._files.pop((name, slot), None)
        if descriptor is not None:
            with contextlib.suppress(OSError):  # it is closed nevertheless, and all data were synced
                os.close(descriptor)
