"""Two files for each name, written in turn and in place, so that the newest whole version is never touched.

No directory and no file size changes by a write, which on a journalling file system cost ten times as
much as the data. A slot, `NAME.0` or `NAME.1`, begins with a line of sequence number, length and checksum;
the content follows as it is. A slot that holds nothing on purpose says so in its first line.

A slot without a byte counts as damaged: so a card that has lost a file leaves it. The slots of a secret must belong to
the user of the process, and hold a version or nothing good: one that was taken back counts as damaged, so that a secret
that was lost does not pass for none.
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
from firmware_py.files.reading import UNFIT, open_regular, read_regular
from firmware_py.files.writing import FILE_MODE, PRIVATE_MODE, set_aside, sync_directory, write_atomically
from firmware_py.system.state_export import KEY_ENDING, RECORD_ENDING, BrokenExportError, largest_bytes, pending_import

SLOTS = (0, 1)
# Earlier versions keep the same records as text under this ending. They stay whole there for a roll-back.
_EARLIER_ENDING = ".state"
_ASIDE_ENDING = ".old"
SLOT_BYTES = 4096  # a slot is made this large at once, and grows by as much
_HEAD = re.compile(rb"# rambler state (\d{1,18}) (\d{1,12}) ([0-9a-f]{8})\n")
_EMPTY = b"# rambler empty\n"


class Condition(Enum):
    """What a slot is found to be: a lost version is another thing than none."""

    WHOLE = "is whole"
    EMPTY = "is empty"
    ABSENT = "is missing"
    DAMAGED = "is damaged"
    UNREADABLE = "cannot be read"


class _Slot(msgspec.Struct, frozen=True):
    """One slot: its number, what it is found to be, and the version in it."""

    number: int
    condition: Condition
    sequence: int = 0
    content: bytes = b""
    reason: str = ""


def stored_content(directory: Path, name: str) -> bytes | None:
    """Return the newest whole version of a name, or None: safe beside an autopilot that is writing."""
    return examine(directory, name).content


def examine(directory: Path, name: str, owner_uid: int | None = None) -> Stored:
    """Return the newest whole version of a name and what is wrong: a slot may be damaged, unreadable or missing.

    `owner_uid` is given for a secret: whose slots they must be. What an import that was cut off has brought counts.
    A record counts only where no slot of an earlier version lies beside it: that version has run since, or may
    run again after a roll-back.
    """
    with contextlib.suppress(BrokenExportError, OSError):  # which the store reports
        awaited = pending_import(directory)
        if awaited is not None and name in awaited.files:
            return Stored(awaited.content(name))
    for path in earlier_slots(directory, name):
        return Stored(damage=f"{path.name} is of another version")
    slots = _read_slots(directory, name, owner_uid)
    newest = _newest(slots)
    # The second version went into the other slot: since then neither is missing.
    both = newest is not None and newest.sequence > 1
    wrong = [
        f"{name}.{slot.number} {slot.condition.value}{slot.reason and f' ({slot.reason})'}"
        for slot in slots
        if slot.condition in (Condition.DAMAGED, Condition.UNREADABLE) or (both and slot.condition is Condition.ABSENT)
    ]
    return Stored(None if newest is None else newest.content, ", ".join(wrong))


def is_secret(name: str) -> bool:
    """Whether what has this name is for nobody but the owner to read."""
    return Path(name).suffix == KEY_ENDING


def slot_path(directory: Path, name: str, slot: int) -> Path:
    """Return the file of a slot."""
    return directory / f"{name}.{slot}"


def earlier_name(name: str) -> str:
    """Return the name under which earlier versions kept a record, empty for a text."""
    return f"{name.removesuffix(RECORD_ENDING)}{_EARLIER_ENDING}" if name.endswith(RECORD_ENDING) else ""


def earlier_slots(directory: Path, name: str) -> list[Path]:
    """Return the slots in which an earlier version keeps a record; none for a text."""
    earlier = earlier_name(name)
    paths = [slot_path(directory, earlier, slot) for slot in SLOTS] if earlier else []
    return [path for path in paths if os.path.lexists(path)]


def _read_slots(directory: Path, name: str, owner_uid: int | None) -> tuple[_Slot, ...]:
    max_bytes = largest_bytes(name)
    return tuple(_read_slot(slot_path(directory, name, slot), slot, max_bytes, owner_uid) for slot in SLOTS)


def _read_slot(path: Path, number: int, max_bytes: int, owner_uid: int | None) -> _Slot:
    try:
        stranger_uid = None if owner_uid in (None, (uid := path.lstat().st_uid)) else uid
        data = b"" if stranger_uid is not None else read_regular(path, max_bytes, follow=False)
    except (FileNotFoundError, NotADirectoryError):  # the latter is the directory's fault, which is told as such
        return _Slot(number, Condition.ABSENT)
    except OSError as error:
        return _Slot(number, Condition.UNREADABLE, reason=error.strerror or "")
    if stranger_uid is not None:
        return _Slot(number, Condition.UNREADABLE, reason=f"it belongs to user {stranger_uid}")
    if data.startswith(_EMPTY):
        return _Slot(number, Condition.EMPTY)
    head = _HEAD.match(data)
    if head is not None:
        content = data[head.end() : head.end() + int(head[2])]
        if len(content) == int(head[2]) and _checksum(head[1], content) == head[3]:
            return _Slot(number, Condition.WHOLE, int(head[1]), content)
    return _Slot(number, Condition.DAMAGED)


def _newest(slots: tuple[_Slot, ...]) -> _Slot | None:
    whole = [slot for slot in slots if slot.condition is Condition.WHOLE]
    return max(whole, key=lambda slot: slot.sequence, default=None)


def _checksum(sequence: bytes, content: bytes) -> bytes:
    return f"{zlib.crc32(content, zlib.crc32(sequence)):08x}".encode()


def _make_fit_for_secret(path: Path) -> None:
    """See to it that nobody else can read what will be written; OSError when that cannot be.

    A file of another user is replaced in one step by an empty one of ours: there is always one to tell of a loss.
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


def _in_blocks(count: int) -> int:
    return -(-count // SLOT_BYTES) * SLOT_BYTES


class SlotWriter:
    """Writes versions: it knows where the newest ones lie, and keeps the files open.

    Opening one again costs more than half of what the disk takes.
    """

    def __init__(self, directory: Path, private: frozenset[str]) -> None:
        """Take the directory, and the names that are for nobody but the owner to read."""
        self._directory = directory
        self._private = private
        self._places: dict[str, tuple[int, int]] = {}  # slot and sequence of the newest version that is surely on disk
        self._stored: set[str] = set()  # names that this writer has saved
        self._unproven: dict[str, int] = {}  # the slot that may hold a whole version whose storing has failed
        self._files: dict[tuple[str, int], int] = {}
        self._named = False  # a file was made whose name may not be on disk yet, whatever became of its content
        self.versions = 0
        self.written_bytes = 0  # in whole blocks, as a disk takes them

    def close(self) -> None:
        """Close the files."""
        for name, slot in tuple(self._files):
            self._close_slot(name, slot)

    def write(self, name: str, content: bytes) -> None:
        """Write a new version into the slot that does not hold the newest one, and force it to disk.

        After an OSError the version before is the newest again, unless `is_unproven`.
        """
        try:
            self._places[name] = self._write_slot(name, content)
            del self._unproven[name]
            self._stored.add(name)
        except OSError:
            with contextlib.suppress(OSError):
                self.withdraw(name)
            for slot in SLOTS:
                self._close_slot(name, slot)
            raise

    def clear(self, name: str) -> None:
        """Leave nothing of a name that is no secret, as a start without it finds; OSError when that cannot be."""
        for slot in SLOTS:
            if slot_path(self._directory, name, slot).exists():
                self._blank(name, slot)
        self._places.pop(name, None)

    def set_aside(self, name: str) -> None:
        """Rename the slots in which an earlier version keeps a record; OSError when that cannot be.

        A record that this version saved in an earlier run is older than those slots, so it is cleared first.
        """
        paths = earlier_slots(self._directory, name)
        if not paths:
            return
        if name not in self._stored:
            self.clear(name)
        for path in paths:
            os.replace(path, f"{path}{_ASIDE_ENDING}")  # noqa: PTH105 - the tests' disk stands before the calls of os
        sync_directory(self._directory)

    def is_unproven(self, name: str) -> bool:
        """Whether a version whose storing has failed may be read at the next start."""
        return name in self._unproven

    def withdraw(self, name: str) -> None:
        """Take back a version whose storing has failed, so that none reads it; OSError when that cannot be."""
        slot = self._unproven.get(name)
        if slot is None:
            return
        try:
            self._blank(name, slot)
        except OSError:
            self._close_slot(name, slot)
            slot_path(self._directory, name, slot).unlink(missing_ok=True)
            sync_directory(self._directory)
        del self._unproven[name]

    def _blank(self, name: str, slot: int) -> None:
        descriptor, present = self._open_slot(name, slot)
        self._write_whole(descriptor, self._nothing_in(name).ljust(max(present, SLOT_BYTES), b"\0"))
        os.fdatasync(descriptor)

    def _place(self, name: str) -> tuple[int, int]:
        """Return slot and sequence of the newest version; an unreadable slot is never what is written beside."""
        slots = _read_slots(self._directory, name, os.geteuid() if name in self._private else None)
        for number in [slot.number for slot in slots if slot.condition is Condition.DAMAGED]:
            if name not in self._private:
                self._close_slot(name, number)
                set_aside(slot_path(self._directory, name, number))  # to be looked into
        newest = _newest(slots)
        if newest is not None:
            # A process that was killed may have left it, and its name, in memory only, and the other slot is next.
            os.fdatasync(self._open_slot(name, newest.number)[0])
            self._named = True
            return newest.number, newest.sequence
        unreadable = [slot.number for slot in slots if slot.condition is Condition.UNREADABLE]
        for slot in unreadable[1:]:
            self._blank(name, slot)  # what it holds might win when it can be read again
        return (1 - unreadable[0] if unreadable else SLOTS[1]), 0

    def _write_slot(self, name: str, content: bytes) -> tuple[int, int]:
        # Kept after a failure: looked up anew, the failed version might pass for the newest.
        place = self._places.get(name)
        if place is None:
            place = self._places[name] = self._place(name)
        slot, number = 1 - place[0], place[1] + 1
        sequence = b"%d" % number
        data = b"# rambler state %s %d %s\n" % (sequence, len(content), _checksum(sequence, content)) + content
        size = _in_blocks(len(data))
        if size > largest_bytes(name):
            raise OSError(errno.EFBIG, "it is too large to be read again")
        descriptor, present = self._open_slot(name, slot)
        if name in self._private:
            data = data.ljust(max(size, present), b"\0")  # nothing of a longer secret is to stay behind this one
        self._unproven[name] = slot
        if present < size:
            # Real bytes, so that the space is there before it is needed.
            self._write_whole(descriptor, self._nothing_in(name).ljust(size, b"\0"))
        self.versions += 1
        self._write_whole(descriptor, data)
        os.fdatasync(descriptor)
        if self._named:
            sync_directory(self._directory)
            self._named = False
        return slot, number

    def _write_whole(self, descriptor: int, data: bytes) -> None:
        """Write at the beginning of a file; OSError when not all of it finds room."""
        self.written_bytes += _in_blocks(len(data))
        if os.pwrite(descriptor, data, 0) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _open_slot(self, name: str, slot: int) -> tuple[int, int]:
        """Return the descriptor of a slot and its size."""
        kept = self._files.get((name, slot))
        if kept is not None:
            status = os.fstat(kept)
            if status.st_nlink:
                return kept, status.st_size
            self._close_slot(name, slot)  # removed, or another put in its place
        path, mode = slot_path(self._directory, name, slot), PRIVATE_MODE if name in self._private else FILE_MODE
        if name in self._private:
            _make_fit_for_secret(path)
        self._named |= not path.exists()
        flags, max_bytes = os.O_RDWR | os.O_CREAT, largest_bytes(name)
        try:
            descriptor = open_regular(path, flags=flags, mode=mode, follow=False, max_bytes=max_bytes)
        except OSError as error:
            if error.errno not in UNFIT:
                raise
            set_aside(path)
            descriptor = open_regular(path, flags=flags, mode=mode, follow=False, max_bytes=max_bytes)
        self._files[name, slot] = descriptor
        return descriptor, os.fstat(descriptor).st_size

    def _nothing_in(self, name: str) -> bytes:
        """Return how a slot begins that holds no version."""
        return b"" if name in self._private else _EMPTY

    def _close_slot(self, name: str, slot: int) -> None:
        descriptor = self._files.pop((name, slot), None)
        if descriptor is not None:
            with contextlib.suppress(OSError):  # closed all the same, and what was forced to disk is there
                os.close(descriptor)
