"""Runs captures through the code of the drivers and says what each message holds.

Every result has `line` and `type`. For nmea, `line` is counted from 1 and split at LF, and
`sentence` is the address; for binary protocols `line` counts the results and `offset` the
bytes of the capture. Types are heading, position, course, turn_rate, rudder, transducer,
wind, weather, water_speed, depth, steering, time, module_info, `other` for a whole message of a
kind that is not decoded, and `error`: its `error` is "checksum", "no checksum",
"malformed" or "range", and `detail`, when there, says more. `unknown` names transducers
of XDR that are not known, each once.

Values have their unit in their name and are None where the message leaves them empty.
Headings are `heading_true_deg` and `heading_magnetic_deg`; a result of type heading repeats
them as `true_deg` and `magnetic_deg`. Nothing is judged beyond its range: status letters
and a fix that is none are reported beside the values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgspec

from firmware_py.sensors.binary_framing import Packet, PacketFramer
from firmware_py.sensors.message_error import MessageError

Result = dict[str, Any]

CHUNK = 4096
_SHORT_NAMES = (("heading_true_deg", "true_deg"), ("heading_magnetic_deg", "magnetic_deg"))
_WHOLE = frozenset({"satellites", "quality"})
_DIGITS = 9  # a ten-thousandth of a millimetre on the ground; hides the noise of binary fractions


class CaptureFormat(msgspec.Struct, frozen=True):
    """A protocol as `rambler decode` knows it: its name there, and one result for each message of a capture."""

    name: str
    decode: Callable[[bytes], Iterator[Result]]


def chunks(data: bytes) -> Iterator[bytes]:
    """Yield a capture as a driver reads, so that a long one is not copied as a whole."""
    return (data[start : start + CHUNK] for start in range(0, len(data), CHUNK))


def decode_packets(data: bytes, framer: PacketFramer, read: Callable[[bytes], Result]) -> Iterator[Result]:
    """Yield one result for each packet of a binary protocol; `read` may raise MessageError."""
    line = 0
    for packets in (*map(framer.feed, chunks(data)), framer.finish()):
        for packet in packets:
            line += 1
            yield {"line": line, "offset": packet.offset, **_packet_result(packet, read)}


def _packet_result(packet: Packet, read: Callable[[bytes], Result]) -> Result:
    if packet.fault:
        return {"type": "error", "error": packet.fault, "bytes": packet.size}
    try:
        return read(packet.data)
    except MessageError as error:
        return {"type": "error", "error": error.error, "detail": str(error)}


def values_of(topic: str, numbers: Mapping[str, Any]) -> Result:
    """Round the values of a message, and give headings their short names too."""
    values: Result = {name: _tidy(name, value) for name, value in numbers.items()}
    if topic == "heading":
        values |= {short: values[name] for name, short in _SHORT_NAMES if name in values}
    return values


def _tidy(name: str, value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return int(value) if name in _WHOLE else round(value, _DIGITS)


def format_text(result: Mapping[str, Any]) -> str:
    """Write a result as one line for people; a dash stands for an empty field."""
    short = {name for _, name in _SHORT_NAMES}
    where = [f"line {result['line']}:", str(result["type"])]
    values = [
        f"{name} {'-' if value is None else value}"
        for name, value in result.items()
        if name not in {"line", "type", "sentence", "error", "detail"} | short
    ]
    named = [str(result[name]) for name in ("sentence", "error") if name in result]
    detail = [f"({result['detail']})"] if "detail" in result else []
    text = " ".join(part for part in (*where, *named, ", ".join(values), *detail) if part)
    # A capture's own bytes must not steer the terminal.
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
