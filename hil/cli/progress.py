"""Progress of long tasks: one line that is rewritten on a terminal, or a new line every 30 s in a pipe."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

TERMINAL_INTERVAL_S = 0.2
PIPE_INTERVAL_S = 30.0
HOUR_S, MINUTE_S = 3600.0, 60.0


class Report(Protocol):
    """A function that reports progress."""

    def __call__(self, done: int, total: int, done_now: int, last: str = "") -> None:
        """Report `done` of `total` runs, `done_now` of them by this process, and the name of the last one."""


@contextmanager
def progress_line(stream: TextIO, now_s: Callable[[], float]) -> Iterator[Report]:
    """Yield the function that reports progress.

    The rate is measured from the first report, because code may be compiled before it.
    """
    is_terminal = stream.isatty()
    next_s = now_s() + (0.0 if is_terminal else PIPE_INTERVAL_S)
    first_report: tuple[float, int] | None = None

    def report(done: int, total: int, done_now: int, last: str = "") -> None:
        nonlocal first_report, next_s
        t_s = now_s()
        first_report = first_report or (t_s, done_now)
        if t_s < next_s:
            return
        next_s = t_s + (TERMINAL_INTERVAL_S if is_terminal else PIPE_INTERVAL_S)
        text = _format_progress(done, total, (done_now - first_report[1]) / max(t_s - first_report[0], 1e-9)) + (
            last and f"; {last}"
        )
        # A line wider than the terminal could not be rewritten.
        stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}" if is_terminal else f"{text}\n")
        stream.flush()

    try:
        yield report
    finally:
        if is_terminal:
            stream.write("\r\x1b[K")
            stream.flush()


def task_progress(stream: TextIO, now_s: Callable[[], float]) -> Callable[[str, float], None]:
    """Return a function that reports a task and its completed fraction; fraction 1 removes the line on a terminal."""
    is_terminal = stream.isatty()
    next_s = now_s() + PIPE_INTERVAL_S

    def report(task: str, fraction: float) -> None:
        nonlocal next_s
        text = f"{100.0 * fraction:3.0f} %  {task}" if fraction < 1.0 else ""
        if is_terminal:
            stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
            stream.flush()
        elif text and (t_s := now_s()) >= next_s:
            next_s = t_s + PIPE_INTERVAL_S
            stream.write(f"{text}\n")
            stream.flush()

    return report


def _format_progress(done: int, total: int, runs_per_s: float) -> str:
    if runs_per_s == 0.0:
        return f"{done} of {total} runs"
    left = f", {_format_duration((total - done) / runs_per_s)} left" if done < total else ""
    return f"{done} of {total} runs, {runs_per_s:.3g} a second{left}"


def _format_duration(seconds: float) -> str:
    if seconds >= HOUR_S:
        return f"{seconds / HOUR_S:.1f} h"
    return f"{seconds / MINUTE_S:.0f} min" if seconds >= MINUTE_S else f"{seconds:.0f} s"
