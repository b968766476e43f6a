"""The status of a running autopilot for other programs on the same computer: a file in memory, written every second.

Readers do not block the autopilot, and memory cards are not worn. The name of the file depends on the path of the state
directory, which need not be writable. The file is removed at a normal end; an old file means that the loop is blocked
or the process was killed.
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

# The service manager or a tmpfiles line creates the first; the second exists on every Linux.
DIRECTORIES = (Path("/run/rambler"), Path("/dev/shm"))  # noqa: S108 - see StatusFile.write
MAX_STATUS_BYTES = 1 << 18
MAX_AGE_S = 5.0  # it is written every second
TRIAL_DIRECTORY = ".rambler-update"  # where an update tests the new program
_PREFIX = "rambler-status-"
_MEMORY_FILE_SYSTEMS = ("tmpfs", "ramfs")


class Freshness(Enum):
    """State of a status file; STALE if it is old or its process has ended."""

    RUNNING = "running"
    STALE = "stale"
    ABSENT = "absent"


class StatusReading(msgspec.Struct, frozen=True):
    """Result of reading a status: content, age, and the reason if it is not current.

    With `is_refused`, the file belongs to an untrusted user and may prevent the autopilot from writing its own.
    """

    freshness: Freshness
    content: Mapping[str, Any] = msgspec.field(default_factory=dict)
    age_s: float | None = None
    reason: str = ""
    is_refused: bool = False


def file_name(state_directory: Path) -> str:
    """Return the name of the status file for a state directory; all paths to the directory give the same name."""
    path = os.fsencode(os.path.realpath(state_directory))
    return f"{_PREFIX}{hashlib.sha256(path).hexdigest()[:16]}.json"


def is_in_memory(directory: Path) -> bool:
    """Return whether a directory is in memory; raises OSError."""
    device = directory.stat().st_dev
    number = f"{os.major(device)}:{os.minor(device)}"
    # One mount per line: id, parent, device, root, mount point, options ..., "-", type, source, options (proc(5)).
    lines = [
        line.split() for line in Path("/proc/self/mountinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    ]
    return any(fields[2] == number and fields[fields.index("-") + 1] in _MEMORY_FILE_SYSTEMS for fields in lines)


class StatusFile:
    """Writes the status file."""

    def __init__(self, state_directory: Path, directories: Sequence[Path] = DIRECTORIES) -> None:
        """Store the state directory, and the directories to try in order."""
        self._name = file_name(state_directory)
        self._directories = directories
        self._path: Path | None = None

    def write(self, content: bytes) -> None:
        """Replace the file atomically; raises OSError if no directory is usable."""
        if self._path is None or not self._path.parent.is_dir():
            self._path = self._choose_path()
        # A new file each time, so that no link is followed and no file of another user is written.
        write_atomically(self._path, content)

    def remove(self) -> None:
        """Remove the file."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()

    def _choose_path(self) -> Path:
        for directory in self._directories:
            with contextlib.suppress(OSError):
                if os.access(directory, os.W_OK | os.X_OK) and is_in_memory(directory):
                    return directory / self._name
        names = ", ".join(map(str, self._directories))
        raise OSError(errno.ENOENT, f"none of {names} is in memory and writable")


def find_status(state_directory: Path, machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> StatusReading:
    """Return the status of the autopilot of a state directory; `machine_s` is the present time of clock.machine_s."""
    paths = [directory / file_name(state_directory) for directory in directories]
    return _newest_of([_read(path, machine_s, state_directory) for path in paths if os.path.lexists(path)])


def find_all_statuses(machine_s: float, directories: Sequence[Path] = DIRECTORIES) -> dict[str, StatusReading]:
    """Return the status of every autopilot on this computer by file name, except in tests of an update."""
    paths = [
        path for directory in directories if directory.is_dir() for path in sorted(directory.glob(f"{_PREFIX}*.json"))
    ]
    statuses: dict[str, list[StatusReading]] = {}
    for path in paths:
        status = _read(path, machine_s, None)
        if not status.is_refused and TRIAL_DIRECTORY not in Path(status.content.get("state_directory", "")).parts:
            statuses.setdefault(path.name, []).append(status)
    return {name: _newest_of(versions) for name, versions in statuses.items()}


def _newest_of(statuses: Sequence[StatusReading]) -> StatusReading:
    absent = StatusReading(Freshness.ABSENT, reason="not running, or ended normally")
    return min(statuses, key=lambda status: float("inf") if status.age_s is None else status.age_s, default=absent)


def _trusted_owners(path: Path, state_directory: Path) -> set[int]:
    """Return the ids of the users whose status files are trusted, because any user can write to /dev/shm.

    They are root, the owner of the state directory, and the owner of a directory that others cannot write to.
    """
    owners = {0}
    with contextlib.suppress(OSError, ValueError):
        owners.add(state_directory.stat().st_uid)
    with contextlib.suppress(OSError):
        status = path.parent.stat()
        if not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            owners.add(status.st_uid)
    return owners


def _read(path: Path, machine_s: float, state_directory: Path | None) -> StatusReading:
    """Read a status file and check its owner; without `state_directory`, use the one that the file names."""
    try:
        owner_uid = path.lstat().st_uid
        owners = {owner_uid} if state_directory is None else _trusted_owners(path, state_directory)
        content = read_json(read_regular(path, MAX_STATUS_BYTES, follow_symlinks=False, owners=owners))
        age_s = machine_s - float(content["written_machine_s"])
        pid = int(content["pid"])
        content |= {"user": _user_name(owner_uid), "state_directory": str(content["state_directory"])}
        if state_directory is None:
            named_directory = Path(content["state_directory"])
            if owner_uid not in _trusted_owners(path, named_directory) or file_name(named_directory) != path.name:
                raise PermissionError(errno.EPERM, f"is not of {named_directory}")
    except OSError as error:
        hint = "; use an account of its group" if error.errno == errno.EACCES else ""
        is_refused = error.errno not in (errno.EACCES, errno.ENOENT)
        return StatusReading(Freshness.ABSENT, reason=f"{path}: {error.strerror}{hint}", is_refused=is_refused)
    except (ValueError, TypeError, KeyError):
        return StatusReading(Freshness.ABSENT, reason=f"{path}: not a status file; remove it")
    if not _is_running(pid):
        return StatusReading(Freshness.STALE, content, age_s, f"process {pid} has ended unexpectedly")
    if not -MAX_AGE_S <= age_s <= MAX_AGE_S:
        reason = f"process {pid} does not update its status: it hangs or is stopped, or {path.parent} is full"
        return StatusReading(Freshness.STALE, content, age_s, reason)
    return StatusReading(Freshness.RUNNING, content, age_s)


def _user_name(uid: int) -> str:
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
