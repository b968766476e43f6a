"""What is read from recordings: onboard logs, their replay, and what identification takes."""

import functools
import itertools
import json
import struct
import zlib
from types import SimpleNamespace

import numpy as np

from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.log import schema
from firmware_py.log.dataflash import FMT_TYPE, HEAD_BYTES, MARK, LogError, Parser, header
from firmware_py.log.reader import LogReader
from firmware_py.log.replay import replay_log
from fuzz.files import as_file, waking_state
from fuzz.target import Target, check_line, records
from hil.errors import UsageError
from hil.lab.identify import manoeuvre_file, onboard_log

END_OF_TICK = 0xFF  # a kind of record


def check_reading(reader):
    for tick in reader:
        assert tick.inputs.tick.index >= 0
    for note in reader.reading.notes:
        assert note.isprintable(), repr(note)
    assert reader.reading.garbage_bytes >= 0
    assert reader.reading.tail_bytes >= 0


def log_file(data):
    """Read any bytes as a log, without the checksum of its ticks and with it mended."""
    parser = Parser(data)
    found = sum(one.length for one, _ in parser)
    assert found + parser.garbage_bytes + parser.tail_bytes == len(data)
    check_reading(LogReader(data))
    mended = bytearray(data)
    begin = None
    for one, at in Parser(data):
        if one.name == schema.TICK.type.name:
            begin = at
        elif one.name == schema.END.name and begin is not None and one.number != FMT_TYPE:
            end = at + one.length - schema.CRC_BYTES
            mended[end : end + schema.CRC_BYTES] = struct.pack("<I", zlib.crc32(data[begin:end]))
    check_reading(LogReader(bytes(mended)))


@functools.cache
def log_head():
    """A log of this version up to its first tick, with the state before it."""
    tick = SimpleNamespace(index=0, t_s=0.0)
    return header(schema.TYPES, 0), schema.CHECKPOINT.pack_text(0.0, tick, state_to_text(waking_state()))


def log_of(data):
    """Return the log whose messages these records are; kind 0xFF ends a tick and begins the next."""
    head, state = log_head()
    ticks, gaps = [[]], [0]
    for kind, body in records(data):
        if kind == END_OF_TICK:
            ticks.append([])
            gaps.append(body[0] if body else 0)
        else:
            row = schema.TYPES[kind % len(schema.TYPES)]
            values = body[: row.size - HEAD_BYTES].ljust(row.size - HEAD_BYTES, b"\0")
            ticks[-1].append(MARK + bytes((row.number,)) + values)
    ticks[0][1:1] = [state]  # behind TICK
    numbers = itertools.accumulate(1 + gap for gap in gaps)
    return head + b"".join(
        schema.end_bytes(b"".join(messages), 0.0, number) for messages, number in zip(ticks, numbers, strict=True)
    )


def replay(data):
    """Recompute a log of this version that holds any numbers."""
    report = replay_log(log_of(data), state_from_text, step)
    json.dumps(report.as_dict(), allow_nan=False)
    for note in report.reading.notes:
        assert note.isprintable(), repr(note)
    assert report.compared <= report.ticks


# ------------------------------------------------------------------------------------ identification


def check_recording(recording):
    size = recording.time_s.size
    for column in (
        recording.time_s,
        recording.rudder_rad,
        recording.heading_rad,
        recording.yaw_rate_rad_s,
        recording.speed_m_s,
    ):
        assert column is None or (column.shape == (size,) and np.isfinite(column).all())
    assert (np.diff(recording.time_s) > 0.0).all()
    for note in recording.notes:
        check_line(note)


@as_file
def manoeuvre_table(path):
    for unit in manoeuvre_file.RUDDER_UNITS[1:]:
        try:
            manoeuvre_file.read(path, unit)
        except UsageError:
            pass
    check_recording(manoeuvre_file.read(path))


def identified_log(data):
    """Read a log as identification does."""

    @as_file
    def read(path):
        check_recording(onboard_log.read(path))

    read(log_of(data))


COLUMNS = (
    b"time_s,",
    b"rudder_rad,",
    b"heading_rad,",
    b"yaw_rate_rad_s,",
    b"speed_m_s,",
    b"heading_deg;",
    b"2026-01-01T00:00:00Z",
)
TARGETS = {
    "log_file": Target(log_file, (LogError,), (b"\xa3\x95\x80",), 16_384),
    "replay": Target(replay, (LogError,)),
    "manoeuvre_table": Target(manoeuvre_table, (UsageError,), COLUMNS),
    "identified_log": Target(identified_log, (UsageError,)),
}
