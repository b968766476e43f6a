"""Which installation of the autopilot is in force: a link, and beside it what a trial of another one needs.

`rambler` leads to the program of one environment; the service starts what it leads to. On trial there are, in the same
directory, `.rambler.before`, a link to the program that was in force, and `.rambler.trial`, whose first line is the
program on trial and which grows by a line with each start. What starts the service (templates/rambler.trial) counts,
and after STARTS starts without a passed trial renames the first over `rambler` and the second to `.rambler.failed`.
Each step is one rename, and whatever ends between two of them leaves a program that can be started.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.files.reading import read_regular

STARTS: Final = 3
TRIAL_S: Final = 120.0  # a run that has lived so long has passed
UPDATE_FILE: Final = "update.state"  # in the state directory: which program has passed its trial
_MOST_BYTES = 1 << 16


class Trial(msgspec.Struct, frozen=True):
    """A trial under way, or one that has failed: the program, and how often it was started."""

    program: Path
    starts: int

    @property
    def name(self) -> str:
        """Return the name of the environment of the program."""
        return self.program.parents[1].name


def passed_text(program: Path) -> str:
    """Return what the state directory keeps of a trial that was passed; what starts the service looks for that line."""
    return f"passed {program}\n"


class ProgramLink:
    """The link to the program in force; every method that changes something raises OSError when it cannot."""

    def __init__(self, path: Path) -> None:
        """Take the path of the link."""
        self.path = path
        self._before, self._trial, self._failed, self._new = (
            path.with_name(f".{path.name}.{ending}") for ending in ("before", "trial", "failed", "new")
        )

    def target(self) -> Path | None:
        """Return the program in force, None when there is no such link."""
        return _target(self.path)

    def before(self) -> Path | None:
        """Return the program that was in force before, None when there is none."""
        return _target(self._before)

    def trial(self) -> Trial | None:
        """Return the trial under way of the program in force, None when there is none."""
        trial = _read(self._trial)
        return trial if trial is not None and trial.program == self.target() else None

    def failed(self) -> Trial | None:
        """Return the last trial that has failed, None when there is none since the last switch."""
        return _read(self._failed)

    def switch(self, program: Path) -> None:
        """Put a program in force, on trial; the one before is what it returns to."""
        before = self.target()
        if before is None:
            raise FileNotFoundError(2, "is no link to a program", str(self.path))
        for remnant in (self._failed, self._trial):
            remnant.unlink(missing_ok=True)
        self._lead(self._before, before)
        with self._new.open("wb") as file:
            file.write(f"{program}\n".encode())
            file.flush()
            os.fsync(file.fileno())
        self._new.replace(self._trial)
        self._sync()
        self._lead(self.path, program)
        self._sync()

    def end_trial(self) -> None:
        """Let the program in force stay."""
        self._trial.unlink(missing_ok=True)

    def _lead(self, link: Path, target: Path) -> None:
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
        lines = read_regular(path, _MOST_BYTES, follow=False).decode("utf-8").splitlines()
        if lines and lines[0].startswith("/"):
            return Trial(Path(lines[0]), len(lines) - 1)
    return None
