"""The link to the installed program, and the files of a trial.

The service starts the program to which the link `rambler` points. During a trial the same directory contains
`.rambler.before`, a link to the previous program, and `.rambler.trial`, whose first line is the program on trial;
each start appends a line. The start script (templates/rambler.trial) counts the lines. After STARTS starts without a
passed trial it renames `.rambler.before` to `rambler` and `.rambler.trial` to `.rambler.failed`. Each step is one
rename, so that after any interruption the link points to a program that can be started.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.files.reading import read_regular

STARTS: Final = 3
TRIAL_S: Final = 120.0  # run time after which the trial is passed
UPDATE_FILE: Final = "update.state"  # name in the state directory; content: passed_line
_MAX_BYTES = 1 << 16


class Trial(msgspec.Struct, frozen=True):
    """A trial: the program and its number of starts."""

    program: Path
    starts: int

    @property
    def name(self) -> str:
        """Return the name of the environment of the program."""
        return self.program.parents[1].name


def passed_line(program: Path) -> str:
    """Return the line that records a passed trial in the state directory; the start script searches for it."""
    return f"passed {program}\n"


class ProgramLink:
    """The link to the installed program; methods that change files raise OSError on failure."""

    def __init__(self, path: Path) -> None:
        """Store the path of the link."""
        self.path = path
        self._previous_path, self._trial_path, self._failed_path, self._temporary_path = (
            path.with_name(f".{path.name}.{suffix}") for suffix in ("before", "trial", "failed", "new")
        )

    def target(self) -> Path | None:
        """Return the installed program; None without a link."""
        return _read_target(self.path)

    def previous(self) -> Path | None:
        """Return the previous program; None without one."""
        return _read_target(self._previous_path)

    def trial(self) -> Trial | None:
        """Return the trial of the installed program; None without one."""
        trial = _read_trial(self._trial_path)
        return trial if trial is not None and trial.program == self.target() else None

    def failed(self) -> Trial | None:
        """Return the failed trial since the last switch; None without one."""
        return _read_trial(self._failed_path)

    def switch(self, program: Path) -> None:
        """Install a program on trial; after a failed trial, the present one is installed again."""
        previous = self.target()
        if previous is None:
            raise FileNotFoundError(2, "is not a link to a program", str(self.path))
        for path in (self._failed_path, self._trial_path):
            path.unlink(missing_ok=True)
        self._replace_link(self._previous_path, previous)
        with self._temporary_path.open("wb") as file:
            file.write(f"{program}\n".encode())
            file.flush()
            os.fsync(file.fileno())
        self._temporary_path.replace(self._trial_path)
        self._sync()
        self._replace_link(self.path, program)
        self._sync()

    def end_trial(self) -> None:
        """End the trial; the installed program stays."""
        self._trial_path.unlink(missing_ok=True)

    def _replace_link(self, link: Path, target: Path) -> None:
        self._temporary_path.unlink(missing_ok=True)
        self._temporary_path.symlink_to(target)
        self._temporary_path.replace(link)

    def _sync(self) -> None:
        descriptor = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _read_target(link: Path) -> Path | None:
    try:
        return Path(os.path.abspath(link.parent / link.readlink()))  # noqa: PTH100 - resolve() would follow links
    except OSError:
        return None


def _read_trial(path: Path) -> Trial | None:
    with contextlib.suppress(OSError, ValueError):
        lines = read_regular(path, _MAX_BYTES, follow_symlinks=False).decode("utf-8").splitlines()
        if lines and lines[0].startswith("/"):
            return Trial(Path(lines[0]), len(lines) - 1)
    return None
