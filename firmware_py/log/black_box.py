"""Black boxes: the last minutes before a restart or a severe fault, cut out of a log and stored longer than it.

A box is a log itself: the head of the original file, which describes all columns, followed by whole ticks.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from firmware_py.files.packed import SUFFIX
from firmware_py.files.writing import DIRECTORY_MODE, sync_directory
from firmware_py.log import schema
from firmware_py.log.archive import Span, Spans, archive_spans
from firmware_py.log.dataflash import HEAD_BYTES, MARK, Format
from firmware_py.log.disk import BOXES

BEFORE_S: Final = 300.0
AFTER_S: Final = 30.0
_TICK_MARK: Final = MARK + bytes((schema.TICK.type.number,))
_END_MARK: Final = MARK + bytes((schema.END.number,))
_TYPE: Final = schema.TICK.type
_TICK: Final = Format(_TYPE.number, _TYPE.size, _TYPE.name, _TYPE.values, _TYPE.labels)
_CHUNK_BYTES: Final = 1 << 16
_LINEAR_SEARCH_BYTES: Final = 1 << 17  # below this length the bisection stops


class TickPosition(NamedTuple):
    """Offset, number and time of a tick in a log."""

    offset: int
    number: int
    t_s: float


def box_path(log: Path, moment: str) -> Path:
    """Return the path of the box of a log at a moment: its time in seconds, or `end`."""
    return log.parent / BOXES / f"{log.name.partition('.')[0]}-{moment}.BIN{SUFFIX}"


def make_box(log: Path, moment: str, event_s: float = math.inf) -> Iterator[None]:
    """Cut out BEFORE_S before and AFTER_S after a time, by default before the end of the log. A step is a block.

    If the log starts within this span, the end of the previous log is included if it connects without a gap. A log
    without a whole tick gives no box. Raises OSError.
    """
    path = box_path(log, moment)
    if path.exists():
        return
    with contextlib.ExitStack() as opened:
        descriptor, size = _open(log, opened)
        first = next_tick(descriptor, 0, size)
        if first is None:
            return
        if math.isinf(event_s):
            event_s = last_tick(descriptor, first, size).t_s
        begin = offset_of_tick(descriptor, first, size, event_s - BEFORE_S)
        end = offset_of_tick(descriptor, first, size, event_s + AFTER_S)
        spans = [Span(descriptor, 0, first.offset)]
        if begin == first.offset:
            spans += _end_of_previous_log(log, first, event_s - BEFORE_S, opened)
        spans.append(Span(descriptor, begin, end))
        with contextlib.suppress(FileExistsError):
            os.mkdir(path.parent, DIRECTORY_MODE)  # noqa: PTH102 - tests inject errors into calls of os
            sync_directory(log.parent)
        yield from archive_spans(Spans(spans), path, os.fstat(descriptor).st_mtime)


def is_first_of_run(log: Path) -> bool:
    """Return whether a log is the first of a run of the program. Raises OSError."""
    with contextlib.ExitStack() as opened:
        descriptor, size = _open(log, opened)
        first = next_tick(descriptor, 0, size)
        return first is None or first.number == 0


def next_tick(descriptor: int, offset: int, end: int) -> TickPosition | None:
    """Return the first tick of a section of a file, None without one.

    The first tick of a file follows its head, every other tick follows an END.
    """
    follows_end = offset > 0
    before = schema.END.size if follows_end else 0
    size = _TICK.length
    while offset + size <= end:
        data = os.pread(descriptor, min(_CHUNK_BYTES + before + size, end - offset), offset)
        at = data.find(_TICK_MARK, before)
        while 0 <= at <= len(data) - size:
            if not follows_end or data[at - before : at - before + HEAD_BYTES] == _END_MARK:
                values = dict(zip(_TICK.labels, _TICK.unpack(data, at), strict=True))
                if math.isfinite(values["T"]):
                    return TickPosition(offset + at, values["Tick"], values["T"])
            at = data.find(_TICK_MARK, at + 1)
        if len(data) <= before + size:
            return None
        offset += len(data) - before - size
    return None


def offset_of_tick(descriptor: int, first: TickPosition, end: int, t_s: float) -> int:
    """Return the offset of the first tick at a time or later, or the end; ticks are in order of time."""
    if first.t_s >= t_s:
        return first.offset
    low, high = first.offset, end
    while high - low > _LINEAR_SEARCH_BYTES:
        middle = (low + high) // 2
        tick = next_tick(descriptor, middle, high)
        if tick is None or tick.t_s >= t_s:
            high = middle
        else:
            low = tick.offset
    at: TickPosition | None = TickPosition(low, 0, -math.inf)
    while at is not None and at.t_s < t_s:
        at = next_tick(descriptor, at.offset + 1, end)
    return end if at is None else at.offset


def last_tick(descriptor: int, first: TickPosition, end: int) -> TickPosition:
    """Return the last tick that starts in a file."""
    back = _LINEAR_SEARCH_BYTES
    at: TickPosition | None = None
    while at is None and end - back > first.offset:
        at = next_tick(descriptor, end - back, end)
        back *= 2
    tick = at or first
    while (at := next_tick(descriptor, tick.offset + 1, end)) is not None:
        tick = at
    return tick


def _end_of_previous_log(log: Path, first: TickPosition, t_s: float, opened: contextlib.ExitStack) -> list[Span]:
    """Return the ticks of the previous log from a time on, if it is not archived and `first` follows its last tick."""
    before = log.with_name(f"{int(log.name.partition('.')[0]) - 1:08d}.BIN")
    try:
        descriptor, size = _open(before, opened)
    except OSError:
        return []
    its_first = next_tick(descriptor, 0, size)
    if its_first is None or last_tick(descriptor, its_first, size).number + 1 != first.number:
        return []
    return [Span(descriptor, offset_of_tick(descriptor, its_first, size, t_s), size)]


def _open(path: Path, opened: contextlib.ExitStack) -> tuple[int, int]:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    opened.callback(os.close, descriptor)
    return descriptor, os.fstat(descriptor).st_size
