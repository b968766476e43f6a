"""The end of a command that makes a run: summary and page of the data so far, however it ends."""

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
    """Write and print summary and page of the run in a directory; of an interrupted run if it had begun."""
    before = _record_of(out)
    try:
        yield
    except UsageError:  # the run has not begun
        raise
    except BaseException as error:
        if _record_of(out) not in (None, before):
            _report_partial(out, interrupted=isinstance(error, KeyboardInterrupt))
        raise
    _print(*run_page.make(out))


def _record_of(out: Path) -> tuple[int, int] | None:
    try:
        found = (out / run_file.NAME).stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _report_partial(out: Path, *, interrupted: bool) -> None:
    try:
        figures, report = run_page.make(out)
    except HilError as error:  # the caller reports the error that ended the run
        print(f"rambler-hil: no report: {error}", file=sys.stderr)
        return
    if interrupted:
        print(figures["ending"])
        _print(figures, report)


def _print(figures: Summary, report: Path) -> None:
    print(figures_text(figures))
    print(f"report: {report}")
