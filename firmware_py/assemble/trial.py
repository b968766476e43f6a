"""A version on trial: reported at each start, and passed once it has run long enough.

A failed trial returns to the previous version. So the records of that version keep their names until the trial ends.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Output
from firmware_py.install.program_link import STARTS, TRIAL_S, UPDATE_FILE, ProgramLink, passed_text
from firmware_py.system.state_directory import RECORD_FILES
from firmware_py.system.store import Store


def link_of(program: str) -> ProgramLink | None:
    """Return the link by which this program was started, None when it was started otherwise."""
    return ProgramLink(Path(program)) if Path(program).is_absolute() and Path(program).is_symlink() else None


class TrialWatch:
    """Tells of the trial that a program was started on, or of one that has failed; `text` is for the status."""

    def __init__(
        self, link: ProgramLink | None, store: Store, notices: list[Event], say: Callable[[str], None]
    ) -> None:
        """Look what is under way; `say` takes a line for the console, `notices` what stations and log are told."""
        self._store, self._notices, self._say = store, notices, say
        self._trial = None if link is None else link.trial()
        if self._trial is None:
            store.set_aside(RECORD_FILES)
        failed = None if link is None else link.failed()
        self._since_s: float | None = None
        self.text = ""
        if self._trial is not None:
            self._tell(Severity.NOTICE, f"On trial: {self._trial.name}, start {self._trial.starts} of {STARTS}")
        elif failed is not None:
            self._tell(Severity.WARNING, f"Update taken back: {failed.name} has not passed in {failed.starts} starts")

    def update(self, _output: Output, now_s: float) -> None:
        """Look at the time after a tick: a program that has sailed for TRIAL_S has passed."""
        if self._trial is None:
            return
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s >= TRIAL_S:
            self._store.save(UPDATE_FILE, passed_text(self._trial.program).encode())
            self._store.set_aside(RECORD_FILES)
            self._tell(Severity.NOTICE, f"Trial passed: {self._trial.name}")
            self._trial = None

    def _tell(self, severity: Severity, text: str) -> None:
        self.text = text
        self._say(text)
        self._notices.append(Event(severity, text))
