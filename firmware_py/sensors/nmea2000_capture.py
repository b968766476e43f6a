"""Decodes captures of NMEA 2000 for `rambler decode`: Actisense, Yacht Devices RAW, and logs of candump -L."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

from firmware_py.common.driver import CaptureFormat
from firmware_py.sensors.decode import Result, round_values
from firmware_py.sensors.message_error import CHECKSUM, MessageError
from firmware_py.sensors.nmea2000_frames import FrameJoiner, Message, split_identifier
from firmware_py.sensors.nmea2000_gateways import ANY_LINE, actisense_bodies, is_valid_body, message_of_body
from firmware_py.sensors.nmea2000_heading import HEADING, heading_of
from firmware_py.sensors.nmea2000_layout import read_numbers, read_texts
from firmware_py.sensors.nmea2000_table import LAYOUTS

TOPICS: Mapping[int, str] = {
    126992: "time",
    127245: "rudder",
    127250: "heading",
    127251: "turn_rate",
    127257: "attitude",
    128267: "depth",
    129025: "position",
    129026: "course",
    129029: "position",
    129038: "vessel",
    129039: "vessel",
    129794: "vessel",
    129809: "vessel",
    129810: "vessel",
    130306: "wind",
}
_CANDUMP_LINE = re.compile(rb"\(\d+\.\d+\) \S+ ([0-9A-F]{8})#((?:[0-9A-F]{2}){0,8})\b")
_FRAME_INTERVAL_S = 0.01  # assumed without a time: the order of the frames decides


def decode_capture(data: bytes) -> Iterator[Result]:
    """Yield one result per message of a capture."""
    if b"\x10\x02\x93" in data:  # DLE STX and the command of a received message
        yield from _decode_actisense(data)
    else:
        yield from _decode_lines(data)


def _decode_actisense(data: bytes) -> Iterator[Result]:
    for number, (offset, body) in enumerate(actisense_bodies(data), start=1):
        head = {"line": number, "offset": offset}
        if is_valid_body(body):
            yield {**head, **_decode_message(message_of_body(body))}
        else:
            yield {**head, "type": "error", "error": CHECKSUM}


def _decode_lines(data: bytes) -> Iterator[Result]:
    """Decode lines with one CAN frame each; a message of several frames belongs to the line of the last one."""
    fast = {pgn for pgn, layout in LAYOUTS.items() if layout.is_fast}
    joiner = FrameJoiner(LAYOUTS.keys() - fast, fast)
    lost = 0
    for number, line in enumerate(data.split(b"\n"), start=1):
        head = {"line": number}
        if match := ANY_LINE.search(line + b"\n"):
            identifier, frame = int(match[2], 16), bytes.fromhex(match[3].decode("ascii"))
        elif match := _CANDUMP_LINE.search(line):
            identifier, frame = int(match[1], 16), bytes.fromhex(match[2].decode("ascii"))
        elif line.strip():
            yield {**head, "type": "error", "error": "malformed"}
            continue
        else:
            continue
        pgn, source = split_identifier(identifier)
        if pgn not in LAYOUTS:
            yield {**head, "type": "other", "pgn": pgn, "source": source}
        elif (message := joiner.add(identifier, frame, number * _FRAME_INTERVAL_S)) is not None:
            yield {**head, **_decode_message(message)}
        if joiner.lost != lost:
            lost = joiner.lost
            yield {**head, "type": "error", "error": "malformed", "pgn": pgn, "detail": "incomplete message"}


def _decode_message(message: Message) -> Result:
    """Return the values of a message, angles in degrees."""
    head = {"pgn": message.pgn, "source": message.source}
    layout = LAYOUTS.get(message.pgn)
    if layout is None:
        return {"type": "other", **head}
    topic = TOPICS[message.pgn]
    try:
        numbers = dict(read_numbers(layout, message.data))
    except MessageError as error:
        return {"type": "error", "error": error.error, **head, "detail": str(error)}
    values: dict[str, float | int | None] = {}
    if message.pgn == HEADING and (heading := heading_of(numbers)) is not None:
        values[f"heading_{heading[1].name.lower()}_deg"] = math.degrees(heading[0])
    for name, value in numbers.items():
        if name in head:
            continue  # the source of PGN 126992
        unit = next((unit for unit in ("_rad_s", "_rad") if name.endswith(unit)), "")
        if unit:
            in_degrees = None if value is None else math.degrees(value)
            values[f"{name.removesuffix(unit)}{unit.replace('rad', 'deg')}"] = in_degrees
        else:
            values[name] = value
    texts = read_texts(layout, message.data)
    return {"type": topic, **head, "message": layout.name, **round_values(topic, values), **texts}


CAPTURE_FORMAT = CaptureFormat("nmea2000", decode_capture)
