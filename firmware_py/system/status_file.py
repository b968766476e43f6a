"""What a running autopilot says of itself to whoever is on the same computer: a file in memory, new each second.

Whoever reads it does so without the autopilot's knowledge, so nobody can hold it up, and no flash card is worn. It is
found by the path of the state directory, which therefore need not be writable. A file that has become old tells that
the loop stands still, or how things were when the process was killed; at an end in good order it is removed.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import pwd
import stat
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import msgspec

from firmware_py.files.reading import read_json, read_regular
from firmware_py.files.writing import write_atomically

# The first is made by a service manager or a tmpfiles line and the second is on every Linux; whatever is not memory is
# passed over.
DIRECTORIES = (Path("/run/rambler"), Path("/dev/shm"))  # noqa: S108 - see StatusFile.write
MAX_STATUS_BYTES = 1 << 18
STALE_S = 5.0  # the slowest loop writes every second
TRIAL_DIRECTORY = ".rambler-update"  # where an update tries a program: it talks of no boat
_PREFIX = "rambler-status-"
_MEMORY = ("tmpfs", "ramfs")


class Freshness(Enum):
    """What a status is worth."""

    RUNNING = "running"
    STALE = "stale"
    ABSENT = "absent"


class FoundStatus(msgspec.Struct, frozen=True):
    """What was found of an autopilot: what it said, how long ago, and why it is not to be taken for what is now.

    `is_refused`: a file lies there that is not believed, and may stand in the way of the true one.
    """

    freshness: Freshness
    content: Mapping[str, Any] = msgspec.field(default_factory=dict)
    age_s: float | None = None
    reason: str = ""
    is_refused: bool = False


def file_name(state_directory: Path) -> str:
    """Return the name of the file for a state directory, the same whatever path leads there."""
    path = os.fsencode(os.path.realpath(state_directory))
    return f"{_PREFIX}{hashlib.sha256(path).hexdigest()[:16]}.json"


def is_memory(directory: Path) -> bool:
    """Whether what is written into a directory reaches no disk; OSError when that cannot be found out."""
    device = directory.stat().st_dev
    number = f"{os.major(device)}:{os.minor(device)}"
    # One mount a line: id, parent, device, root, place, options ..., "-", type, source, options (proc(5)).
    lines = [
        line.split() for line in Path("/proc/self/mountinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    ]
    return any(words[2] == number and words[words.index("-") + 1] in _MEMORY for words in lines)


class StatusFile:
    """The writing side."""

    def __init__(self, state_directory: Path, directories: Sequence[Path] = DIRECTORIES) -> None:
        """Remember whose status it is, and the directories that are tried in turn."""
        self._name = file_name(state_directory)
        self._directories = directories
        self._path: Path | None = None

    def write(self, content: bytes) -> None:
        """Replace what was written before, so that nobody reads a mixture; OSError when no directory takes it."""
        if self._path is None or not self._path.parent.is_dir():
            self._path = self._choose()
        # Made anew each time, and never through a link or into a file of somebody else who may write there, too.
        write_atomically(self._path, content)

    def remove(self) -> None:
        """Say nothing any more."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()

    def _choose(self) -> Path:
        for directory in self._directories:
            with contextlib.suppress(OSError):
                if os.access(directory, os.W_OK | os.X_OK) and is_memory(directory):
                    return directory / self._name
        places = ", ".join(map(str, self._directories))
        raise OSError(errno.ENOENT, f"none of {places} is in memory and may be written to")


def find(state_directory: Path, machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> FoundStatus:
    """Return what the autopilot on a state directory says; `machine_s` is now (system.clock.machine_s)."""
    paths = [directory / file_name(state_directory) for directory in directories]
    return _newest([_read(path, machine_s, state_directory) for path in paths if os.path.lexists(path)])


def find_all(machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> dict[str, FoundStatus]:
    """Return what every autopilot on this computer says, by the names of their files; not what an update tries."""
    paths = [
        path for directory in directories if directory.is_dir() for path in sorted(directory.glob(f"{_PREFIX}*.json"))
    ]
    found: dict[str, list[FoundStatus]] = {}
    for path in paths:
        one = _read(path, machine_s, None)
        if not one.is_refused and TRIAL_DIRECTORY not in Path(one.content.get("state_directory", "")).parts:
            found.setdefault(path.name, []).append(one)
    return {name: _newest(versions) for name, versions in found.items()}


def _newest(found: Sequence[FoundStatus]) -> FoundStatus:
    nothing = FoundStatus(Freshness.ABSENT, reason="it is not running, or has ended in good order")
    return min(found, key=lambda one: float("inf") if one.age_s is None else one.age_s, default=nothing)


def _owners(path: Path, state_directory: Path) -> set[int]:
    """Return the user ids whose status files are read: root, the owners of the state directory and a private directory.

    Any user can put a file into /dev/shm.
    """
    owners = {0}
    with contextlib.suppress(OSError, ValueError):
        owners.add(state_directory.stat().st_uid)
    with contextlib.suppress(OSError):
        status = path.parent.stat()
        if not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            owners.add(status.st_uid)
    return owners


def _read(path: Path, machine_s: float, state_directory: Path | None) -> FoundStatus:
    """Read a file; without `state_directory` that which the file names is asked whose word counts."""
    try:
        owner_uid = path.lstat().st_uid
        owners = {owner_uid} if state_directory is None else _owners(path, state_directory)
        content = read_json(read_regular(path, MAX_STATUS_BYTES, follow=False, owners=owners))
        age_s = machine_s - float(content["written_machine_s"])
        pid = int(content["pid"])
        content |= {"user": _user(owner_uid), "state_directory": str(content["state_directory"])}
        if state_directory is None:
            named = Path(content["state_directory"])
            if owner_uid not in _owners(path, named) or file_name(named) != path.name:
                raise PermissionError(errno.EPERM, f"is not of {named}")
    except OSError as error:
        hint = "; look as a user of its group" if error.errno == errno.EACCES else ""
        refused = error.errno not in (errno.EACCES, errno.ENOENT)
        return FoundStatus(Freshness.ABSENT, reason=f"{path}: {error.strerror}{hint}", is_refused=refused)
    except (ValueError, TypeError, KeyError):
        return FoundStatus(Freshness.ABSENT, reason=f"{path}: it is no status; remove it")
    if not _lives(pid):
        return FoundStatus(Freshness.STALE, content, age_s, f"process {pid} is gone without having ended in good order")
    if not -STALE_S <= age_s <= STALE_S:
        why = f"process {pid} is there and says nothing: it hangs or is halted, or {path.parent} is full"
        return FoundStatus(Freshness.STALE, content, age_s, why)
    return FoundStatus(Freshness.RUNNING, content, age_s)


def _user(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)  # signal 0 is none: it asks whether there is somebody
    except (ProcessLookupError, OverflowError, ValueError):
        return False
    except OSError:
        return True  # of another user
    return True
