"""Reads the ticks of a log of any length; the log may be truncated or damaged.

Messages and columns are found by name, so logs of other versions are readable: `Reading.notes` lists unknown and
missing ones. TICK, END and the command in CTL are required.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.common.records import Inputs, RudderCommand
from firmware_py.log import ardupilot, schema
from firmware_py.log.dataflash import Buffer, Format, LogError, MessageType, Parser, decode_text
from firmware_py.log.message_rows import RowReader
from firmware_py.log.open_file import open_buffer

MAX_RECORDS: Final = 1 << 17  # in one tick, so that a damaged log needs limited memory; two texts of maximum length fit

_REQUIRED_ROWS: Final = (schema.TICK, schema.CONTROL)
_SKIPPED: Final = frozenset(message.name for message in (*schema.TYPES, *ardupilot.TYPES)) - schema.READ_ROWS.keys()


class LoggedTick(msgspec.Struct, frozen=True):
    """One tick of a log.

    `command` is the logged rudder command. `checkpoint` is the state before the tick, None if the log has none there.
    With `gap`, ticks are missing before this one.
    """

    inputs: Inputs
    command: RudderCommand
    checkpoint: str | None
    gap: bool


class Reading(msgspec.Struct, frozen=True):
    """Result of reading a log so far.

    `damaged` is the number of damaged ticks, `garbage_bytes` the number of bytes between records, `tail_bytes` the
    number of bytes from an unfinished tick to the end. `notes` lists the messages and columns of a log of another
    version that are unknown, missing or omitted.
    """

    software: str = ""
    ticks: int = 0
    damaged: int = 0
    garbage_bytes: int = 0
    tail_bytes: int = 0
    notes: tuple[str, ...] = ()


class LogReader:
    """An iterable of the ticks of one log; `reading` is the result after the iteration."""

    def __init__(self, source: Path | bytes) -> None:
        """Read from a file, compressed or not, or from the content of one."""
        self._source = source
        self.reading = Reading()

    def __iter__(self) -> Iterator[LoggedTick]:
        """Yield the whole ticks in order; raises LogError if the file cannot be read or lacks required columns."""
        if isinstance(self._source, bytes):
            yield from self._ticks(self._source)
            return
        try:
            with open_buffer(self._source) as data:
                yield from self._ticks(data)
        except OSError as error:
            raise LogError(f"{error.strerror or error}: give the path of a .BIN or .BIN.gz file") from error

    def _ticks(self, buffer: Buffer) -> Iterator[LoggedTick]:
        parser = Parser(buffer)
        scan = _Scan(buffer)
        unfinished_from: int | None = None
        for file_format, offset in parser:
            if file_format.name == schema.TICK.type.name:
                unfinished_from = offset
            tick = scan.add(file_format, offset)
            if file_format.name == schema.END.name:
                unfinished_from = None
            self.reading = scan.reading(parser.garbage_bytes, 0)
            if tick is not None:
                yield tick
        tail_bytes = parser.tail_bytes if unfinished_from is None else len(buffer) - unfinished_from
        self.reading = scan.reading(parser.garbage_bytes, tail_bytes)


def read_log(source: Path | bytes) -> Iterator[LoggedTick]:
    """Yield the whole ticks of a log in order; raises LogError if it cannot be read."""
    return iter(LogReader(source))


class _Scan:
    """Assembles ticks from records."""

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._readers: dict[Format, RowReader] = {}
        self._records: list[tuple[Format, int]] | None = None  # since TICK; None between ticks
        self._crc = 0
        self._last_sequence: int | None = None
        self.software = ""
        self.ticks = 0
        self.damaged = 0
        self._notes: dict[str, None] = {}
        self._unknown_counts: Counter[str] = Counter()  # messages, by name

    def reading(self, garbage_bytes: int, tail_bytes: int) -> Reading:
        """Return the result up to the last record."""
        unknown = (
            f"message {name}: not known here, {count} passed over" for name, count in self._unknown_counts.items()
        )
        notes = (*self._notes, *unknown)
        return Reading(self.software, self.ticks, self.damaged, garbage_bytes, tail_bytes, notes)

    def add(self, file_format: Format, offset: int) -> LoggedTick | None:
        """Process the next record; return the tick that it completes, or None."""
        if file_format.name == schema.TICK.type.name:
            self.damaged += self._records is not None
            self._records, self._crc = [], 0
        if file_format.name == schema.END.name:
            return self._end_tick(file_format, offset)
        if self._records is None:
            if not self.software and _has_format(file_format, ardupilot.MSG):
                self.software = decode_text(file_format.unpack(self._buffer, offset)[1])
        elif len(self._records) < MAX_RECORDS:
            self._crc = zlib.crc32(self._buffer[offset : offset + file_format.length], self._crc)
            self._records.append((file_format, offset))
        return None

    def _end_tick(self, file_format: Format, offset: int) -> LoggedTick | None:
        records, self._records = self._records, None
        tick = None
        if "Seq" not in file_format.labels or (file_format.labels[-1], file_format.values[-1]) != ("Crc", "I"):
            raise LogError("message END has no Seq or no Crc: use the version of rambler that wrote the log")
        values = file_format.unpack(self._buffer, offset)
        sequence, crc = values[file_format.labels.index("Seq")], values[-1]
        checked_bytes = self._buffer[offset : offset + file_format.length - schema.CRC_BYTES]
        if records is not None and zlib.crc32(checked_bytes, self._crc) == crc:
            gap = self._last_sequence is not None and sequence != self._last_sequence + 1
            tick = self._build_tick(records, gap=gap)
        if tick is None:
            self.damaged += 1
        else:
            self.ticks += 1
            self._last_sequence = sequence
        return tick

    def _build_tick(self, records: list[tuple[Format, int]], *, gap: bool) -> LoggedTick | None:
        """Build the tick from its records; return None if they are invalid."""
        records_by_name: dict[str, list[Any]] = {name: [] for name in schema.READ_ROWS}
        for file_format, offset in records:
            if file_format.name in _SKIPPED:
                continue
            row = schema.READ_ROWS.get(file_format.name)
            if row is None:
                self._unknown_counts[file_format.name] += 1
                continue
            if file_format not in self._readers:
                self._readers[file_format] = RowReader(row, file_format, self._notes)
                if row in _REQUIRED_ROWS and (missing := self._readers[file_format].missing):
                    raise LogError(
                        f"message {file_format.name} has no column {', '.join(missing)}: "
                        "use the version of rambler that wrote the log"
                    )
            try:
                record = self._readers[file_format].read(self._buffer, offset)
            except ValueError:
                return None
            if record is not None:
                records_by_name[file_format.name].append(record)
        found = {name: tuple(values) for name, values in records_by_name.items()}
        ticks, commands, checkpoints = (
            found[row.type.name] for row in (schema.TICK, schema.CONTROL, schema.CHECKPOINT)
        )
        if len(ticks) != 1 or len(commands) != 1:
            return None
        inputs = Inputs(
            ticks[0],
            headings=found[schema.HEADING.type.name],
            positions=found[schema.POSITION.type.name],
            rudder=found[schema.FEEDBACK.type.name],
            devices=found[schema.DEVICE.type.name],
            requests=found[schema.REQUEST.type.name],
            power=found[schema.POWER.type.name],
            vessels=(*found[schema.VESSEL.type.name], *found[schema.IDENTITY.type.name]),
            rudder_angles=found[schema.RUDDER_ANGLE.type.name],
            wind=found[schema.WIND.type.name],
            depth=found[schema.DEPTH.type.name],
        )
        return LoggedTick(inputs, commands[0], checkpoints[0] if checkpoints else None, gap)


def _has_format(file_format: Format, expected: MessageType) -> bool:
    """Return whether a message of a file has the expected name, columns and value characters."""
    return (file_format.name, file_format.values, file_format.labels) == (
        expected.name,
        expected.values,
        tuple(expected.labels.split(",")),
    )
