"""Decodes captures with the code of the drivers.

Each result contains `line` and `type`. For nmea, `line` is the line number from 1 (split at LF) and `sentence` the
address. For binary protocols, `line` is the number of the result and `offset` the byte position in the capture; for
vedirect, `line` is the number of the block. Types are heading, position, course, turn_rate, attitude, rudder,
transducer, wind, weather, water_speed, depth, steering, time, vessel, power, module_info, `other` for a valid message
that is not decoded, and `error`, with `error` "checksum", "no checksum", "malformed" or "range" and an optional
`detail`. `unknown` lists unknown transducers of XDR, each once.

Names of values contain the unit; a value is None if its field is empty. Headings are `heading_true_deg` and
`heading_magnetic_deg`; a result of type heading repeats them as `true_deg` and `magnetic_deg`. Values are only checked
for their range: status letters and the fix type are reported next to them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from firmware_py.sensors.binary_framing import Packet, PacketFramer
from firmware_py.sensors.message_error import MessageError

Result = dict[str, Any]

CHUNK_BYTES = 4096
_SHORT_NAMES = (("heading_true_deg", "true_deg"), ("heading_magnetic_deg", "magnetic_deg"))
_INTEGER_VALUES = frozenset({"satellites", "quality"})
_DECIMAL_PLACES = 9  # 0.1 mm on the ground; removes binary rounding errors of degrees


def split_chunks(data: bytes) -> Iterator[bytes]:
    """Yield a capture in chunks of the size of a read, because the framers copy what they receive."""
    return (data[start : start + CHUNK_BYTES] for start in range(0, len(data), CHUNK_BYTES))


def decode_packets(data: bytes, framer: PacketFramer, read: Callable[[bytes], Result]) -> Iterator[Result]:
    """Yield one result per packet of a binary protocol; `read` may raise MessageError."""
    line = 0
    for packets in (*map(framer.feed, split_chunks(data)), framer.finish()):
        for packet in packets:
            line += 1
            yield {"line": line, "offset": packet.offset, **_decode_packet(packet, read)}


def _decode_packet(packet: Packet, read: Callable[[bytes], Result]) -> Result:
    if packet.fault:
        return {"type": "error", "error": packet.fault, "bytes": packet.size}
    try:
        return read(packet.data)
    except MessageError as error:
        return {"type": "error", "error": error.error, "detail": str(error)}


def round_values(topic: str, numbers: Mapping[str, Any]) -> Result:
    """Round the values of a message and add the short names of headings."""
    values: Result = {name: _round_value(name, value) for name, value in numbers.items()}
    if topic == "heading":
        values |= {short: values[name] for name, short in _SHORT_NAMES if name in values}
    return values


def _round_value(name: str, value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return int(value) if name in _INTEGER_VALUES else round(value, _DECIMAL_PLACES)


def format_text(result: Mapping[str, Any]) -> str:
    """Format a result as one readable line with a dash for an empty field."""
    short = {name for _, name in _SHORT_NAMES}
    location = [f"line {result['line']}:", str(result["type"])]
    values = [
        f"{name} {'-' if value is None else value}"
        for name, value in result.items()
        if name not in {"line", "type", "sentence", "error", "detail"} | short
    ]
    labels = [str(result[name]) for name in ("sentence", "error") if name in result]
    detail = [f"({result['detail']})"] if "detail" in result else []
    text = " ".join(part for part in (*location, *labels, ", ".join(values), *detail) if part)
    # Bytes of a capture must not control the terminal.
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
