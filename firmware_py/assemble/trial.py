"""Trial of an updated version: reported at each start, and successful after the time TRIAL_S.

A failed trial returns to the previous version. Therefore the records of that version keep their names until the end of
the trial.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Output
from firmware_py.install.program_link import STARTS, TRIAL_S, UPDATE_FILE, ProgramLink, passed_line
from firmware_py.system.state_directory import RECORD_FILES
from firmware_py.system.store import Store


def find_program_link(program: str) -> ProgramLink | None:
    """Return the program link by which this program was started, None if it was started otherwise."""
    return ProgramLink(Path(program)) if Path(program).is_absolute() and Path(program).is_symlink() else None


class TrialWatch:
    """Reports a running or failed trial; `text` is for the status."""

    def __init__(
        self, link: ProgramLink | None, store: Store, notices: list[Event], say: Callable[[str], None]
    ) -> None:
        """Check for a trial; `say` prints a line, `notices` are the events for ground stations and log."""
        self._store, self._notices, self._say = store, notices, say
        self._trial = None if link is None else link.trial()
        if self._trial is None:
            store.set_aside(RECORD_FILES)
        failed = None if link is None else link.failed()
        self._start_s: float | None = None
        self.text = ""
        if self._trial is not None:
            self._report_text(Severity.NOTICE, f"On trial: {self._trial.name}, start {self._trial.starts} of {STARTS}")
        elif failed is not None:
            self._report_text(Severity.WARNING, f"Update rolled back: {failed.name} failed {failed.starts} starts")

    def update(self, _output: Output, now_s: float) -> None:
        """End the trial successfully after TRIAL_S; called after each tick."""
        if self._trial is None:
            return
        if self._start_s is None:
            self._start_s = now_s
        if now_s - self._start_s >= TRIAL_S:
            self._store.save(UPDATE_FILE, passed_line(self._trial.program).encode())
            self._store.set_aside(RECORD_FILES)
            self._report_text(Severity.NOTICE, f"Trial passed: {self._trial.name}")
            self._trial = None

    def _report_text(self, severity: Severity, text: str) -> None:
        self.text = text
        self._say(text)
        self._notices.append(Event(severity, text))
