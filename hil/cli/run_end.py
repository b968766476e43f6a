"""How a command that puts a boat to sea ends: with the figures and the page of what there is, whatever ends it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.errors import HilError, UsageError
from hil.report import run_page
from hil.report.summary import Summary
from hil.report.text import figures_text
from hil.sim import run_file


@contextmanager
def reported(out: Path) -> Iterator[None]:
    """Write figures and page of the run in a directory and print them; of one cut short, if it had begun."""
    before = _record_of(out)
    try:
        yield
    except UsageError:  # the run has not begun
        raise
    except BaseException as error:
        if _record_of(out) not in (None, before):
            _report_what_there_is(out, told=isinstance(error, KeyboardInterrupt))
        raise
    _tell(*run_page.make(out))


def _record_of(out: Path) -> tuple[int, int] | None:
    try:
        found = (out / run_file.NAME).stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _report_what_there_is(out: Path, *, told: bool) -> None:
    try:
        figures, report = run_page.make(out)
    except HilError as error:  # what has ended the run is told, too
        print(f"rambler-hil: no report: {error}", file=sys.stderr)
        return
    if told:
        print(figures["ending"])
        _tell(figures, report)


def _tell(figures: Summary, report: Path) -> None:
    print(figures_text(figures))
    print(f"report: {report}")
