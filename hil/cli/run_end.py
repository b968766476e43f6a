"""Summary and page at the end of a command that makes a run, complete or not."""

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
def report_at_end(out: Path) -> Iterator[None]:
    """Write and print summary and page of the run in a directory; after a failure only if the run had begun."""
    previous = _file_identity(out)
    try:
        yield
    except UsageError:  # raised before the run has begun
        raise
    except BaseException as error:
        if _file_identity(out) not in (None, previous):
            _report_partial(out, interrupted=isinstance(error, KeyboardInterrupt))
        raise
    _print(*run_page.make(out))


def _file_identity(out: Path) -> tuple[int, int] | None:
    try:
        status = (out / run_file.NAME).stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


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
