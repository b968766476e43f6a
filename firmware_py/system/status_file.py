"""The status of a running autopilot for other programs on the same computer: a file in memory, written every second.

Readers do not block the autopilot, and no flash card wears. The name of the file depends on the path of the state
directory, which need not be writable. An old file means that the loop hangs or the process was killed; at a normal end
it is removed.
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

# The first is created by a service manager or a tmpfiles line, the second exists on every Linux; a directory that is
# not in memory is skipped.
DIRECTORIES = (Path("/run/rambler"), Path("/dev/shm"))  # noqa: S108 - see StatusFile.write
MAX_STATUS_BYTES = 1 << 18
STALE_S = 5.0  # the slowest loop writes every second
TRIAL_DIRECTORY = ".rambler-update"  # an update tests a program there, without a boat
_PREFIX = "rambler-status-"
_MEMORY = ("tmpfs", "ramfs")


class Freshness(Enum):
    """Whether a status is current."""

    RUNNING = "running"
    STALE = "stale"
    ABSENT = "absent"


class FoundStatus(msgspec.Struct, frozen=True):
    """The status of an autopilot: content, age, and the reason if it is not current.

    `is_refused`: there is a file of an untrusted user, which may block the real one.
    """

    freshness: Freshness
    content: Mapping[str, Any] = msgspec.field(default_factory=dict)
    age_s: float | None = None
    reason: str = ""
    is_refused: bool = False


def file_name(state_directory: Path) -> str:
    """Return the name of the file for a state directory, the same for all paths to it."""
    path = os.fsencode(os.path.realpath(state_directory))
    return f"{_PREFIX}{hashlib.sha256(path).hexdigest()[:16]}.json"


def is_memory(directory: Path) -> bool:
    """Whether a directory is in memory; raises OSError."""
    device = directory.stat().st_dev
    number = f"{os.major(device)}:{os.minor(device)}"
    # One mount per line: id, parent, device, root, mount point, options ..., "-", type, source, options (proc(5)).
    lines = [
        line.split() for line in Path("/proc/self/mountinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    ]
    return any(words[2] == number and words[words.index("-") + 1] in _MEMORY for words in lines)


class StatusFile:
    """The writer of the status file."""

    def __init__(self, state_directory: Path, directories: Sequence[Path] = DIRECTORIES) -> None:
        """Set the state directory, and the directories to try in order."""
        self._name = file_name(state_directory)
        self._directories = directories
        self._path: Path | None = None

    def write(self, content: bytes) -> None:
        """Replace the file atomically; raises OSError if no directory is usable."""
        if self._path is None or not self._path.parent.is_dir():
            self._path = self._choose()
        # A new file each time: it never follows a link or writes into a file of another user.
        write_atomically(self._path, content)

    def remove(self) -> None:
        """Remove the file."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()

    def _choose(self) -> Path:
        for directory in self._directories:
            with contextlib.suppress(OSError):
                if os.access(directory, os.W_OK | os.X_OK) and is_memory(directory):
                    return directory / self._name
        names = ", ".join(map(str, self._directories))
        raise OSError(errno.ENOENT, f"none of {names} is in memory and writable")


def find(state_directory: Path, machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> FoundStatus:
    """Return the status of the autopilot of a state directory; `machine_s` is the time (system.clock.machine_s)."""
    paths = [directory / file_name(state_directory) for directory in directories]
    return _newest([_read(path, machine_s, state_directory) for path in paths if os.path.lexists(path)])


def find_all(machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> dict[str, FoundStatus]:
    """Return the status of every autopilot on this computer by file name, without those of update tests."""
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
    absent = FoundStatus(Freshness.ABSENT, reason="not running, or ended normally")
    return min(found, key=lambda one: float("inf") if one.age_s is None else one.age_s, default=absent)


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
    """Read a file; without `state_directory`, use the one named in the file to check the owner."""
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
        hint = "; use an account of its group" if error.errno == errno.EACCES else ""
        refused = error.errno not in (errno.EACCES, errno.ENOENT)
        return FoundStatus(Freshness.ABSENT, reason=f"{path}: {error.strerror}{hint}", is_refused=refused)
    except (ValueError, TypeError, KeyError):
        return FoundStatus(Freshness.ABSENT, reason=f"{path}: not a status file; remove it")
    if not _is_running(pid):
        return FoundStatus(Freshness.STALE, content, age_s, f"process {pid} has ended unexpectedly")
    if not -STALE_S <= age_s <= STALE_S:
        reason = f"process {pid} does not update its status: it hangs or is stopped, or {path.parent} is full"
        return FoundStatus(Freshness.STALE, content, age_s, reason)
    return FoundStatus(Freshness.RUNNING, content, age_s)


def _user(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)  # signal 0 only checks whether the process exists
    except (ProcessLookupError, OverflowError, ValueError):
        return False
    except OSError:
        return True  # of another user
    return True
