"""Runs a capture through the code of the drivers and says what each message holds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from firmware_py.sensors import pni_protocol, ubx_protocol
from firmware_py.sensors.binary_framing import Packet, PacketFramer
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer, Sentence
from firmware_py.sensors.nmea_sentences import decode_sentence
from firmware_py.sensors.pni_reading import read_data

Result = dict[str, Any]

CHUNK = 4096
_SHORT_NAMES = (("heading_true_deg", "true_deg"), ("heading_magnetic_deg", "magnetic_deg"))
_WHOLE = frozenset({"satellites", "quality"})
_DIGITS = 9  # a ten-thousandth of a millimetre on the ground; hides the noise of binary fractions


def decode(kind: str, data: bytes) -> Iterator[Result]:
    """Yield one result for each message of a capture; `kind` is a key of KINDS, else ValueError.

    Every result has `line` and `type`. For nmea, `line` is counted from 1 and split at
    LF, and `sentence` is the address; for pni and ubx `line` counts the results and
    `offset` the bytes of the capture. Types are heading, position, course, turn_rate,
    rudder, transducer, wind, weather, water_speed, steering, time, module_info, `other` for a
    whole message of a kind that is not decoded, and `error`: its `error` is "checksum",
    "no checksum", "malformed" or "range", and `detail`, when there, says more.

    Values have their unit in their name and are None where the message leaves them
    empty. Headings are `heading_true_deg` and `heading_magnetic_deg`; a result of type
    heading repeats them as `true_deg` and `magnetic_deg`. Nothing is judged beyond its
    range: status letters and a fix that is none are reported beside the values.
    """
    if kind not in KINDS:
        raise ValueError(f"no kind of capture: {kind[:20]!r}; there are {', '.join(KINDS)}")
    return KINDS[kind](data)


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
    return " ".join(part for part in (*where, *named, ", ".join(values), *detail) if part)


def _chunks(data: bytes) -> Iterator[bytes]:
    """Feed as a driver reads, so that a long capture is not copied as a whole."""
    return (data[start : start + CHUNK] for start in range(0, len(data), CHUNK))


def _decode_nmea(data: bytes) -> Iterator[Result]:
    framer = NmeaFramer()
    for chunk in _chunks(data):
        yield from map(_nmea_result, framer.feed(chunk))
    yield from map(_nmea_result, framer.finish())


def _nmea_result(sentence: Sentence) -> Result:
    head = {"line": sentence.line}
    name = {"sentence": sentence.address}
    if sentence.fault:
        return {**head, "type": "error", "error": sentence.fault, **name}
    try:
        decoded = decode_sentence(sentence)
    except MessageError as refusal:
        return {**head, "type": "error", "error": refusal.error, **name, "detail": str(refusal)}
    if decoded is None:
        return {**head, "type": "other", **name}
    return {**head, "type": decoded.topic, **name, **_values(decoded.topic, decoded.numbers), **decoded.letters}


def _values(topic: str, numbers: Mapping[str, float | None]) -> Result:
    """Round, and give headings their short names too."""
    values: Result = {name: _tidy(name, value) for name, value in numbers.items()}
    if topic == "heading":
        values |= {short: values[name] for name, short in _SHORT_NAMES if name in values}
    return values


def _tidy(name: str, value: float | None) -> float | None:
    if not isinstance(value, float):
        return value
    return int(value) if name in _WHOLE else round(value, _DIGITS)


def _decode_packets(data: bytes, framer: PacketFramer, read: Callable[[bytes], Result]) -> Iterator[Result]:
    line = 0
    for packets in (*map(framer.feed, _chunks(data)), framer.finish()):
        for packet in packets:
            line += 1
            yield {"line": line, "offset": packet.offset, **_packet_result(packet, read)}


def _packet_result(packet: Packet, read: Callable[[bytes], Result]) -> Result:
    if packet.fault:
        return {"type": "error", "error": packet.fault, "bytes": packet.size}
    try:
        return read(packet.data)
    except MessageError as refusal:
        return {"type": "error", "error": refusal.error, "detail": str(refusal)}


def _decode_pni(data: bytes) -> Iterator[Result]:
    return _decode_packets(data, pni_protocol.framer(), _pni_result)


def _pni_result(packet: bytes) -> Result:
    frame_id = pni_protocol.frame_id(packet)
    if frame_id == pni_protocol.Frame.DATA:
        reading = read_data(pni_protocol.payload(packet))
        return {"type": "heading", "frame_id": frame_id, **_values("heading", dataclasses.asdict(reading))}
    if frame_id == pni_protocol.Frame.MODULE_INFO:
        return {"type": "module_info", "frame_id": frame_id, "module": _ascii(pni_protocol.payload(packet))}
    return {"type": "other", "frame_id": frame_id}


def _decode_ubx(data: bytes) -> Iterator[Result]:
    return _decode_packets(data, ubx_protocol.framer(), _ubx_result)


def _ubx_result(packet: bytes) -> Result:
    message = ubx_protocol.message(packet)
    name = {"message": f"{message >> 8:02X}-{message & 0xFF:02X}"}
    if message != ubx_protocol.NAV_PVT:
        return {"type": "other", **name}
    solution = dataclasses.asdict(ubx_protocol.parse_nav_pvt(ubx_protocol.payload(packet)))
    fix = {"fix": solution.pop("fix").name}
    return {"type": "position", "message": "NAV-PVT", **fix, **_values("position", solution)}


def _ascii(data: bytes) -> str:
    return "".join(chr(byte) if 0x20 <= byte <= 0x7E else "?" for byte in data)


KINDS: Mapping[str, Callable[[bytes], Iterator[Result]]] = {
    "nmea": _decode_nmea,
    "pni": _decode_pni,
    "ubx": _decode_ubx,
}
