"""Progress of long work: a line that is rewritten on a terminal; in a pipe a line every 30 s."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

TERMINAL_S = 0.2
PIPE_S = 30.0
HOUR_S, MINUTE_S = 3600.0, 60.0


class Report(Protocol):
    """A function that reports progress."""

    def __call__(self, done: int, total: int, since: int, last: str = "") -> None:
        """Report `done` of `total` runs, `since` of them in this session, and the name of the last one."""


@contextmanager
def line(stream: TextIO, now_s: Callable[[], float]) -> Iterator[Report]:
    """Yield the function that reports progress.

    The rate counts from the first report on, because code may be compiled before.
    """
    terminal = stream.isatty()
    next_s = now_s() + (0.0 if terminal else PIPE_S)
    first: tuple[float, int] | None = None

    def report(done: int, total: int, since: int, last: str = "") -> None:
        nonlocal first, next_s
        t_s = now_s()
        first = first or (t_s, since)
        if t_s < next_s:
            return
        next_s = t_s + (TERMINAL_S if terminal else PIPE_S)
        text = _text(done, total, (since - first[1]) / max(t_s - first[0], 1e-9)) + (last and f"; {last}")
        # A line wider than the terminal could not be rewritten.
        stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}" if terminal else f"{text}\n")
        stream.flush()

    try:
        yield report
    finally:
        if terminal:
            stream.write("\r\x1b[K")
            stream.flush()


def part_done(stream: TextIO, now_s: Callable[[], float]) -> Callable[[str, float], None]:
    """Return a function that reports the present task and the completed part; at 1 the terminal's line is removed."""
    terminal = stream.isatty()
    next_s = now_s() + PIPE_S

    def report(task: str, part: float) -> None:
        nonlocal next_s
        text = f"{100.0 * part:3.0f} %  {task}" if part < 1.0 else ""
        if terminal:
            stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
            stream.flush()
        elif text and (t_s := now_s()) >= next_s:
            next_s = t_s + PIPE_S
            stream.write(f"{text}\n")
            stream.flush()

    return report


def _text(done: int, total: int, per_s: float) -> str:
    if per_s == 0.0:
        return f"{done} of {total} runs"
    left = f", {_time((total - done) / per_s)} left" if done < total else ""
    return f"{done} of {total} runs, {per_s:.3g} a second{left}"


def _time(seconds: float) -> str:
    if seconds >= HOUR_S:
        return f"{seconds / HOUR_S:.1f} h"
    return f"{seconds / MINUTE_S:.0f} min" if seconds >= MINUTE_S else f"{seconds:.0f} s"
