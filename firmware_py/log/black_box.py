"""Black boxes: the last minutes before a restart or a severe fault, copied from a log and stored longer than the log.

A box is a valid log: the header of the original file, which describes all columns, followed by whole ticks.
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

BEFORE_EVENT_S: Final = 300.0
AFTER_EVENT_S: Final = 30.0
_TICK_MARK: Final = MARK + bytes((schema.TICK.type.number,))
_END_MARK: Final = MARK + bytes((schema.END.number,))
_TICK_TYPE: Final = schema.TICK.type
_TICK_FORMAT: Final = Format(_TICK_TYPE.number, _TICK_TYPE.size, _TICK_TYPE.name, _TICK_TYPE.values, _TICK_TYPE.labels)
_CHUNK_BYTES: Final = 1 << 16
_LINEAR_SEARCH_BYTES: Final = 1 << 17  # below this length the bisection stops


class TickPosition(NamedTuple):
    """Offset, number and time of a tick in a log."""

    offset: int
    number: int
    t_s: float


def box_path(log: Path, moment: str) -> Path:
    """Return the path of the box of a log; `moment` is the time of the event in seconds, or `end`."""
    return log.parent / BOXES / f"{log.name.partition('.')[0]}-{moment}.BIN{SUFFIX}"


def make_box(log: Path, moment: str, event_s: float = math.inf) -> Iterator[None]:
    """Copy the ticks around an event into a box, one block per step; without an event, those before the end of the log.

    The box contains BEFORE_EVENT_S before and AFTER_EVENT_S after the event. If the log starts within this span, the
    end of the previous log is included if it connects without a gap. A log without a whole tick has no box. Raises
    OSError.
    """
    path = box_path(log, moment)
    if path.exists():
        return
    with contextlib.ExitStack() as resources:
        descriptor, size = _open_log(log, resources)
        first_tick = find_next_tick(descriptor, 0, size)
        if first_tick is None:
            return
        if math.isinf(event_s):
            event_s = find_last_tick(descriptor, first_tick, size).t_s
        begin = find_tick_offset(descriptor, first_tick, size, event_s - BEFORE_EVENT_S)
        end = find_tick_offset(descriptor, first_tick, size, event_s + AFTER_EVENT_S)
        spans = [Span(descriptor, 0, first_tick.offset)]
        if begin == first_tick.offset:
            spans += _end_of_previous_log(log, first_tick, event_s - BEFORE_EVENT_S, resources)
        spans.append(Span(descriptor, begin, end))
        with contextlib.suppress(FileExistsError):
            os.mkdir(path.parent, DIRECTORY_MODE)  # noqa: PTH102 - tests inject errors into calls of os
            sync_directory(log.parent)
        yield from archive_spans(Spans(spans), path, os.fstat(descriptor).st_mtime)


def is_first_of_run(log: Path) -> bool:
    """Return whether a log starts with tick 0, the first of a run of the program. Raises OSError."""
    with contextlib.ExitStack() as resources:
        descriptor, size = _open_log(log, resources)
        first_tick = find_next_tick(descriptor, 0, size)
        return first_tick is None or first_tick.number == 0


def find_next_tick(descriptor: int, offset: int, end: int) -> TickPosition | None:
    """Return the first tick between two offsets of a file, None without one.

    The first tick of a file follows the file header, every other tick follows an END record.
    """
    follows_end = offset > 0
    end_bytes = schema.END.size if follows_end else 0
    size = _TICK_FORMAT.length
    for begin in range(offset, end, _CHUNK_BYTES):
        data = os.pread(descriptor, min(_CHUNK_BYTES + end_bytes + size, end - begin), begin)
        position = data.find(_TICK_MARK, end_bytes)
        while 0 <= position <= len(data) - size:
            if not follows_end or data[position - end_bytes : position - end_bytes + HEAD_BYTES] == _END_MARK:
                values = dict(zip(_TICK_FORMAT.labels, _TICK_FORMAT.unpack(data, position), strict=True))
                if math.isfinite(values["T"]):
                    return TickPosition(begin + position, values["Tick"], values["T"])
            position = data.find(_TICK_MARK, position + 1)
    return None


def find_tick_offset(descriptor: int, first_tick: TickPosition, end: int, t_s: float) -> int:
    """Return the offset of the first tick at a time or later, or `end` without one; ticks are in order of time."""
    if first_tick.t_s >= t_s:
        return first_tick.offset
    low, high = first_tick.offset, end
    while high - low > _LINEAR_SEARCH_BYTES:
        middle = (low + high) // 2
        tick = find_next_tick(descriptor, middle, high)
        if tick is None or tick.t_s >= t_s:
            high = middle
        else:
            low = tick.offset
    tick = TickPosition(low, 0, -math.inf)
    while tick is not None and tick.t_s < t_s:
        tick = find_next_tick(descriptor, tick.offset + 1, end)
    return end if tick is None else tick.offset


def find_last_tick(descriptor: int, first_tick: TickPosition, end: int) -> TickPosition:
    """Return the last tick before an offset of a file."""
    tail_bytes = _LINEAR_SEARCH_BYTES
    next_tick: TickPosition | None = None
    while next_tick is None and end - tail_bytes > first_tick.offset:
        next_tick = find_next_tick(descriptor, end - tail_bytes, end)
        tail_bytes *= 2
    last_tick = next_tick or first_tick
    while (next_tick := find_next_tick(descriptor, last_tick.offset + 1, end)) is not None:
        last_tick = next_tick
    return last_tick


def _end_of_previous_log(
    log: Path, first_tick: TickPosition, t_s: float, resources: contextlib.ExitStack
) -> list[Span]:
    """Return the ticks of the previous log from a time on; none if it is archived or `first_tick` does not follow."""
    previous_log = log.with_name(f"{int(log.name.partition('.')[0]) - 1:08d}.BIN")
    try:
        descriptor, size = _open_log(previous_log, resources)
    except OSError:
        return []
    previous_first = find_next_tick(descriptor, 0, size)
    if previous_first is None or find_last_tick(descriptor, previous_first, size).number + 1 != first_tick.number:
        return []
    return [Span(descriptor, find_tick_offset(descriptor, previous_first, size, t_s), size)]


def _open_log(path: Path, resources: contextlib.ExitStack) -> tuple[int, int]:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    resources.callback(os.close, descriptor)
    return descriptor, os.fstat(descriptor).st_size
