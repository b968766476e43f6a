"""How far long work has come: a line that renews itself on a terminal, in a pipe one now and then."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TextIO

RENEW_S = 0.2
NOW_AND_THEN_S = 30.0
HOUR_S, MINUTE_S = 3600.0, 60.0


class Tell(Protocol):
    """Told how many are done, of how many, how many of them since the beginning of this, and which was the last."""

    def __call__(self, done: int, total: int, since: int, last: str = "") -> None:
        """Show it, if it is time to."""


@contextmanager
def line(stream: TextIO, now_s: Callable[[], float]) -> Iterator[Tell]:
    """Yield what is told how far the work has come.

    How fast is counted from the first telling on: before that, what sails may be compiled.
    """
    terminal = stream.isatty()
    next_s = now_s() + (0.0 if terminal else NOW_AND_THEN_S)
    first: tuple[float, int] | None = None

    def tell(done: int, total: int, since: int, last: str = "") -> None:
        nonlocal first, next_s
        t_s = now_s()
        first = first or (t_s, since)
        if t_s < next_s:
            return
        next_s = t_s + (RENEW_S if terminal else NOW_AND_THEN_S)
        text = _text(done, total, (since - first[1]) / max(t_s - first[0], 1e-9)) + (last and f"; {last}")
        # A line that goes on to the next could not be renewed.
        stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}" if terminal else f"{text}\n")
        stream.flush()

    try:
        yield tell
    finally:
        if terminal:
            stream.write("\r\x1b[K")
            stream.flush()


def part_done(stream: TextIO, now_s: Callable[[], float]) -> Callable[[str, float], None]:
    """Return what is told what is being done and which part of all is over; at 1 the terminal's line goes."""
    terminal = stream.isatty()
    next_s = now_s() + NOW_AND_THEN_S

    def tell(what: str, part: float) -> None:
        nonlocal next_s
        text = f"{100.0 * part:3.0f} %  {what}" if part < 1.0 else ""
        if terminal:
            stream.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
            stream.flush()
        elif text and (t_s := now_s()) >= next_s:
            next_s = t_s + NOW_AND_THEN_S
            stream.write(f"{text}\n")
            stream.flush()

    return tell


def _text(done: int, total: int, per_s: float) -> str:
    if per_s == 0.0:
        return f"{done} of {total} runs"
    left = f", {_time((total - done) / per_s)} left" if done < total else ""
    return f"{done} of {total} runs, {per_s:.3g} a second{left}"


def _time(seconds: float) -> str:
    if seconds >= HOUR_S:
        return f"{seconds / HOUR_S:.1f} h"
    return f"{seconds / MINUTE_S:.0f} min" if seconds >= MINUTE_S else f"{seconds:.0f} s"
