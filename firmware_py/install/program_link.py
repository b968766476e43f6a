"""The link to the installed program, and the files of a trial.

The service starts the program that the link `rambler` points to. During a trial the same directory contains
`.rambler.before`, a link to the previous program, and `.rambler.trial`: its first line is the program on trial, each
start appends a line. The start script (templates/rambler.trial) counts the lines. After STARTS starts without a passed
trial it renames the first file to `rambler` and the second to `.rambler.failed`. Each step is one rename, so that an
interruption between two steps leaves a program that can be started.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.files.reading import read_regular

STARTS: Final = 3
TRIAL_S: Final = 120.0  # run time that passes the trial
UPDATE_FILE: Final = "update.state"  # in the state directory: the program that has passed its trial
_MAX_BYTES = 1 << 16


class Trial(msgspec.Struct, frozen=True):
    """A running or failed trial: the program and its number of starts."""

    program: Path
    starts: int

    @property
    def name(self) -> str:
        """Return the name of the environment of the program."""
        return self.program.parents[1].name


def passed_text(program: Path) -> str:
    """Return the line that records a passed trial in the state directory; the start script searches for it."""
    return f"passed {program}\n"


class ProgramLink:
    """The link to the installed program; methods that change files raise OSError on failure."""

    def __init__(self, path: Path) -> None:
        """Take the path of the link."""
        self.path = path
        self._before, self._trial, self._failed, self._new = (
            path.with_name(f".{path.name}.{ending}") for ending in ("before", "trial", "failed", "new")
        )

    def target(self) -> Path | None:
        """Return the installed program; None without a link."""
        return _target(self.path)

    def before(self) -> Path | None:
        """Return the previous program; None without one."""
        return _target(self._before)

    def trial(self) -> Trial | None:
        """Return the running trial of the installed program; None without one."""
        trial = _read(self._trial)
        return trial if trial is not None and trial.program == self.target() else None

    def failed(self) -> Trial | None:
        """Return the failed trial since the last switch; None without one."""
        return _read(self._failed)

    def switch(self, program: Path) -> None:
        """Install a program on trial; a failed trial returns to the present one."""
        before = self.target()
        if before is None:
            raise FileNotFoundError(2, "is not a link to a program", str(self.path))
        for remnant in (self._failed, self._trial):
            remnant.unlink(missing_ok=True)
        self._point(self._before, before)
        with self._new.open("wb") as file:
            file.write(f"{program}\n".encode())
            file.flush()
            os.fsync(file.fileno())
        self._new.replace(self._trial)
        self._sync()
        self._point(self.path, program)
        self._sync()

    def end_trial(self) -> None:
        """End the trial; the installed program stays."""
        self._trial.unlink(missing_ok=True)

    def _point(self, link: Path, target: Path) -> None:
        self._new.unlink(missing_ok=True)
        self._new.symlink_to(target)
        self._new.replace(link)

    def _sync(self) -> None:
        descriptor = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _target(link: Path) -> Path | None:
    try:
        return Path(os.path.abspath(link.parent / link.readlink()))  # noqa: PTH100 - resolve() would follow links
    except OSError:
        return None


def _read(path: Path) -> Trial | None:
    with contextlib.suppress(OSError, ValueError):
        lines = read_regular(path, _MAX_BYTES, follow=False).decode("utf-8").splitlines()
        if lines and lines[0].startswith("/"):
            return Trial(Path(lines[0]), len(lines) - 1)
    return None
