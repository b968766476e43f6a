"""Readers of recordings: onboard logs, replay, and input of the identification."""

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
from fuzz.files import reads_file, resuming_state
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
    """Read any bytes as a log, then again with corrected checksums of the ticks."""
    parser = Parser(data)
    parsed_bytes = sum(record_format.length for record_format, _ in parser)
    assert parsed_bytes + parser.garbage_bytes + parser.tail_bytes == len(data)
    check_reading(LogReader(data))
    corrected = bytearray(data)
    tick_start = None
    for record_format, offset in Parser(data):
        if record_format.name == schema.TICK.type.name:
            tick_start = offset
        elif record_format.name == schema.END.name and tick_start is not None and record_format.number != FMT_TYPE:
            end = offset + record_format.length - schema.CRC_BYTES
            corrected[end : end + schema.CRC_BYTES] = struct.pack("<I", zlib.crc32(data[tick_start:end]))
    check_reading(LogReader(bytes(corrected)))


@functools.cache
def log_start():
    """Return the header of a log of this version, and a checkpoint."""
    tick = SimpleNamespace(index=0, t_s=0.0)
    return header(schema.TYPES, 0), schema.CHECKPOINT.pack_text(0.0, tick, state_to_text(resuming_state()))


def make_log(data):
    """Return a log with these records as messages; kind 0xFF starts the next tick."""
    header_bytes, state = log_start()
    ticks, gaps = [[]], [0]
    for kind, body in records(data):
        if kind == END_OF_TICK:
            ticks.append([])
            gaps.append(body[0] if body else 0)
        else:
            row = schema.TYPES[kind % len(schema.TYPES)]
            values = body[: row.size - HEAD_BYTES].ljust(row.size - HEAD_BYTES, b"\0")
            ticks[-1].append(MARK + bytes((row.number,)) + values)
    ticks[0][1:1] = [state]  # after TICK
    numbers = itertools.accumulate(1 + gap for gap in gaps)
    return header_bytes + b"".join(
        schema.append_end(b"".join(messages), 0.0, number) for messages, number in zip(ticks, numbers, strict=True)
    )


def replay(data):
    """Recompute a log of this version with any values."""
    report = replay_log(make_log(data), state_from_text, step)
    json.dumps(report.as_dict(), allow_nan=False)
    for note in report.reading.notes:
        assert note.isprintable(), repr(note)
    assert report.compared <= report.ticks


# ------------------------------------------------------------------------------------ identification


def check_recording(recording):
    size = recording.time_s.size
    for name in ("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s", "speed_m_s"):
        column = getattr(recording, name)
        assert column is None or (column.shape == (size,) and np.isfinite(column).all())
    assert (np.diff(recording.time_s) > 0.0).all()
    for note in recording.notes:
        check_line(note)


@reads_file
def manoeuvre_table(path):
    for unit in manoeuvre_file.RUDDER_UNITS[1:]:
        try:
            manoeuvre_file.read(path, unit)
        except UsageError:
            pass
    check_recording(manoeuvre_file.read(path))


def identified_log(data):
    """Read a log like the identification."""

    @reads_file
    def read(path):
        check_recording(onboard_log.read(path))

    read(make_log(data))


COLUMNS = (
    *b"time_s, rudder_rad, heading_rad, yaw_rate_rad_s, speed_m_s, heading_deg;".split(),
    b"2026-01-01T00:00:00Z",
)
TARGETS = {
    "log_file": Target(log_file, (LogError,), (b"\xa3\x95\x80",), 16_384),
    "replay": Target(replay, (LogError,)),
    "manoeuvre_table": Target(manoeuvre_table, (UsageError,), COLUMNS),
    "identified_log": Target(identified_log, (UsageError,)),
}
