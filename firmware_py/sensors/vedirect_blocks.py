"""Text protocol of Victron's VE.Direct port: blocks of labelled values, each with a checksum.

A field is CR LF, the label, a tab and the value. The last label is Checksum; the byte after it makes the sum of all
bytes of the block 0 modulo 256. Replies of the hexadecimal protocol, from a colon to a line feed, may occur between the
fields and are ignored. Source: Victron, VE.Direct Protocol, version 3.32.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import msgspec

from firmware_py.common.driver import CaptureFormat
from firmware_py.sensors.decode import Result, round_values, split_chunks
from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, MessageError, check_range

MAX_BLOCK_BYTES = 1024  # 22 fields of 43 bytes at most
_END = b"\r\nChecksum\t"
_HEX_REPLY = re.compile(rb":[0-9A-F]*\n")
_FIELD = re.compile(r"[A-Za-z0-9#_]{1,9}\t[ -~]{0,40}", re.ASCII)
_NUMBER = re.compile(r"[+-]?[0-9]{1,9}", re.ASCII)
_UNKNOWN_VALUE = "---"


class Block(msgspec.Struct, frozen=True):
    """The values of a block by label; `fault` is empty, CHECKSUM or MALFORMED (truncated or too long)."""

    fields: Mapping[str, str]
    fault: str = ""


class Measurement(msgspec.Struct, frozen=True):
    """The values of a block, None if missing; a current into the battery is positive.

    `charge` is the state of charge, 0 to 1; `solar_w` the power of the panels; `load_a` the current of the load output.
    `error` is the error code of a charger, 0 for none; `alarm` are the alarm reasons of a monitor as bits.
    """

    voltage_v: float | None
    current_a: float | None
    charge: float | None
    solar_w: float | None
    load_a: float | None
    temperature_c: float | None
    error: int
    alarm: int


class BlockFramer:
    """Splits a stream into blocks; the result does not depend on how it is divided into calls of `feed`.

    The first block is skipped if it is incomplete: its start was sent before the port was opened.
    """

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._buffer = bytearray()
        self._is_aligned = False  # whether the buffer starts after the end of a block

    def feed(self, data: bytes) -> list[Block]:
        """Add bytes; return the completed blocks."""
        self._buffer += data
        blocks: list[Block] = []
        while (end := self._buffer.find(_END)) >= 0 and len(self._buffer) > end + len(_END):
            size = end + len(_END) + 1
            block_bytes = bytes(self._buffer[:size])
            del self._buffer[:size]
            block = _parse_block(block_bytes)
            if self._is_aligned or not block.fault:
                blocks.append(block)
            self._is_aligned = True
        if len(self._buffer) > MAX_BLOCK_BYTES:
            del self._buffer[: -len(_END)]
            if self._is_aligned:
                blocks.append(Block({}, MALFORMED))
            self._is_aligned = False
        return blocks


def _parse_block(data: bytes) -> Block:
    """Parse the bytes of a block including its checksum."""
    body = _HEX_REPLY.sub(b"", data[: -len(_END) - 1])
    if sum(body) + sum(data[-len(_END) - 1 :]) & 0xFF:
        return Block({}, CHECKSUM)
    lines = body.decode("latin-1").split("\r\n")
    if lines[0] or not all(_FIELD.fullmatch(line) for line in lines[1:]):
        return Block({}, MALFORMED)
    return Block(dict(line.split("\t", 1) for line in lines[1:]))


# Label, field of Measurement, unit in SI, minimum and maximum of each used value.
_QUANTITIES = (
    ("V", "voltage_v", 1e-3, 0.0, 1000.0),
    ("I", "current_a", 1e-3, -5000.0, 5000.0),
    ("SOC", "charge", 1e-3, 0.0, 1.0),
    ("PPV", "solar_w", 1.0, 0.0, 100_000.0),
    ("IL", "load_a", 1e-3, 0.0, 1000.0),
    ("T", "temperature_c", 1.0, -60.0, 150.0),
)


def read_measurement(block: Block) -> Measurement | None:
    """Return the values of a block, None for one without (history of a monitor); raises MessageError."""
    values = {field: _read_number(block, label, unit, low, high) for label, field, unit, low, high in _QUANTITIES}
    error, alarm = _read_number(block, "ERR", 1.0, 0.0, 255.0), _read_number(block, "AR", 1.0, 0.0, 65535.0)
    if all(value is None for value in values.values()) and error is None:
        return None
    has_alarm = block.fields.get("Alarm", "OFF").upper() == "ON"
    return Measurement(**values, error=int(error or 0), alarm=int(alarm or 0) if has_alarm else 0)


def _read_number(block: Block, label: str, unit: float, low: float, high: float) -> float | None:
    text = block.fields.get(label, _UNKNOWN_VALUE)
    if text == _UNKNOWN_VALUE:
        return None
    if not _NUMBER.fullmatch(text):
        raise MessageError(MALFORMED, f"{label} {text[:12]!r} is not a number")
    return check_range(int(text) * unit, low, high, label)


def _decode_capture(data: bytes) -> Iterator[Result]:
    framer = BlockFramer()
    line = 0
    for chunk in split_chunks(data):
        for block in framer.feed(chunk):
            line += 1
            yield {"line": line, **_decode_block(block)}


def _decode_block(block: Block) -> Result:
    if block.fault:
        return {"type": "error", "error": block.fault}
    try:
        measurement = read_measurement(block)
    except MessageError as error:
        return {"type": "error", "error": error.error, "detail": str(error)}
    if measurement is None:
        return {"type": "other"}
    values = {field: getattr(measurement, field) for _, field, *_ in _QUANTITIES}
    known = {name: value for name, value in values.items() if value is not None}
    return {
        "type": "power",
        **round_values("power", known),
        "charger_error": measurement.error,
        "alarm": measurement.alarm,
    }


CAPTURE_FORMAT = CaptureFormat("vedirect", _decode_capture)
