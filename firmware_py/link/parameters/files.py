"""Parameters as files: component metadata for ground stations, and ArduPilot's packed list."""

from __future__ import annotations

import json
import lzma
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from firmware_py.common.parameter_row import Kind, Parameter, ParameterError
from firmware_py.common.parameter_table import GROUPS, INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.files.area import PathParts, mavlink_crc32
from firmware_py.link.telemetry.fields import boot_ms
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.dialect import Message, mavlink, text_of

DIRECTORY = "metadata"
ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
_PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER
_URI = f"mftp://{DIRECTORY}/"
_JSON_TYPES = {Kind.INTEGER: "Int32", Kind.REAL: "Float"}
# The small decoders of stations support this check only. Dictionary and preset are small, since this is compressed at
# each start: the highest preset would save 300 bytes.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 2, "dict_size": 1 << 16}]

PLAIN, WITH_DEFAULTS = 0x671B, 0x671C
_HEAD = struct.Struct("<HHH")
_PACKED_TYPES = {Kind.INTEGER: (3, "i"), Kind.REAL: (4, "f")}
_FORMATS = {1: "b", 2: "h", 3: "i", 4: "f"}
_HAS_DEFAULT = 0x10
_MAX_COMMON = 15


class Metadata:
    """The metadata files, by path, and the messages that refer to them."""

    def __init__(self, version: Version, autopilot: int) -> None:
        """Generate the files of this version for an identity (MAV_AUTOPILOT)."""
        self.autopilot = autopilot
        parameters, compressed = parameter_files(autopilot)
        general = _text(
            {
                "version": 1,
                "vendorName": "Rambler",
                "modelName": "Rambler",
                "firmwareVersion": f"{version.major}.{version.minor}.{version.patch}",
                "metadataTypes": [
                    {
                        "type": _PARAMETER_TYPE,
                        "uri": f"{_URI}parameter.json.xz",
                        "fileCrc": mavlink_crc32(compressed),
                    }
                ],
            }
        )
        self._general = _compressed(general)
        self.files: Mapping[PathParts, bytes] = {
            (DIRECTORY, "general.json"): general,
            (DIRECTORY, "general.json.xz"): self._general,
            (DIRECTORY, "parameter.json"): parameters,
            (DIRECTORY, "parameter.json.xz"): compressed,
        }

    def message(self, t_s: float) -> Message:
        """Return COMPONENT_METADATA."""
        uri = text_of(f"{_URI}general.json.xz", 100)
        return mavlink.mavlink_map[397](boot_ms(t_s), mavlink_crc32(self._general), uri)

    def old_message(self, t_s: float) -> Message:
        """Return COMPONENT_INFORMATION, which older stations request."""
        uri = text_of(f"{_URI}general.json.xz", 100)
        return mavlink.mavlink_map[395](boot_ms(t_s), mavlink_crc32(self._general), uri, 0, b"")


@cache
def parameter_files(autopilot: int) -> tuple[bytes, bytes]:
    """Return parameter.json, plain and compressed; cached, since the table does not change."""
    parameters = _text({"version": 3, "parameters": [_parameter(row, autopilot) for row in TABLE]})
    return parameters, _compressed(parameters)


def parameter_json() -> str:
    """Return parameter.json as text."""
    return parameter_files(ARDUPILOT)[0].decode()


def declared_kind(row: Parameter, autopilot: int) -> Kind:
    """Return the declared type of a parameter.

    Values are sent as floats. Every station knows that of ArduPilot; of other autopilots many take an integer for its
    bytes in the field of a float, so all parameters are declared REAL there.
    """
    return row.kind if autopilot == ARDUPILOT else Kind.REAL


def _parameter(row: Parameter, autopilot: int) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "name": row.name,
        "type": _JSON_TYPES[declared_kind(row, autopilot)],
        "shortDesc": row.text.split(":")[0].split(";")[0].split(". ")[0].rstrip("."),
        "longDesc": row.text,
        "default": _number(row, row.default),
        "min": _number(row, row.minimum),
        "max": _number(row, row.maximum),
        "group": GROUPS.get(row.name.split("_")[0], "Other"),
        "category": "Standard",
    }
    if row.unit:
        entry["units"] = row.unit
    if declared_kind(row, autopilot) is Kind.REAL:
        entry["decimalPlaces"] = _decimal_places(row) if row.kind is Kind.REAL else 0
    if row.choices is not None:
        entry["values"] = [{"value": number, "description": text} for number, text in row.choices.items()]
    if row.reboot:
        entry["rebootRequired"] = True
    if row.read_only:
        entry["readOnly"] = True
        entry["volatile"] = True
    return entry


def _number(row: Parameter, value: float) -> float | int:
    # The shortest decimal of a single: 0.1, not 0.10000000149011612.
    return int(value) if row.kind is Kind.INTEGER else float(f"{value:.7g}")


def _decimal_places(row: Parameter) -> int:
    """Return the number of decimals of a value: four digits of the default, or of the smallest value that is not 0."""
    size = abs(row.default) or abs(row.minimum) or 1.0
    places = 0
    while size < 100.0 and places < 7:
        size *= 10.0
        places += 1
    return max(places, 1)


def _text(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, indent=1).encode("ascii")


def _compressed(content: bytes) -> bytes:
    return lzma.compress(content, lzma.FORMAT_XZ, lzma.CHECK_CRC32, filters=_FILTERS)


def pack(values: ParameterSet, query: Mapping[str, str], autopilot: int) -> bytes:
    """Return the file; the query may hold start, count and withdefaults, and invalid values are ignored.

    The types are those that PARAM_VALUE declares for this identity, since stations store them.
    """
    start, count = _whole(query.get("start"), 0), _whole(query.get("count"), len(TABLE))
    with_defaults = _whole(query.get("withdefaults"), 0) != 0
    rows = range(start, min(start + count, len(TABLE)))
    parts = [_HEAD.pack(WITH_DEFAULTS if with_defaults else PLAIN, len(rows), len(TABLE))]
    before = ""
    for index in rows:
        row, value = TABLE[index], values.values()[index]
        number, form = _PACKED_TYPES[declared_kind(row, autopilot)]
        common = _common(before, row.name)
        ending = row.name[common:].encode("ascii")
        row_values = [value]
        if with_defaults and value != row.default:
            number |= _HAS_DEFAULT
            row_values.append(row.default)
        numbers = [int(number) if form == "i" else number for number in row_values]
        parts.append(bytes((number, common | (len(ending) - 1) << 4)) + ending)
        parts.append(struct.pack(f"<{len(numbers)}{form}", *numbers))
        before = row.name
    return b"".join(parts)


def unpack(content: bytes) -> dict[str, float]:
    """Return the checked values of an uploaded file by name; ParameterError if any is invalid.

    The third number of the head is the length of the file, as in uploads to ArduPilot.
    """
    if len(content) < _HEAD.size:
        raise ParameterError("shorter than its head")
    magic, count, length = _HEAD.unpack_from(content)
    if magic != PLAIN:
        raise ParameterError(f"begins with {magic:#06x} instead of {PLAIN:#06x}")
    if length != len(content):
        raise ParameterError(f"{len(content)} bytes of {length} have come")
    values: dict[str, float] = {}
    rows = 0
    for name, value in _rows(content):
        index = INDEX.get(name)
        if index is None:
            raise ParameterError(f"unknown parameter {name[:16]!r}")
        row = TABLE[index]
        if row.read_only:
            raise ParameterError(f"{name} is read-only")
        values[name] = row.check(value)
        rows += 1
    if rows != count:
        raise ParameterError(f"{rows} parameters instead of {count}")
    return values


def _rows(content: bytes) -> Iterator[tuple[str, float]]:
    position, before = _HEAD.size, b""
    while position < len(content):
        if content[position] == 0:
            position += 1  # padding
            continue
        form = _FORMATS.get(content[position])
        if form is None or position + 1 >= len(content):
            raise ParameterError(f"byte {position} begins no parameter")
        lengths = content[position + 1]
        start = position + 2
        end = start + (lengths >> 4) + 1
        if (lengths & 0x0F) > len(before) or end + struct.calcsize(form) > len(content):
            raise ParameterError(f"the parameter at byte {position} is cut off")
        before = before[: lengths & 0x0F] + content[start:end]
        (value,) = struct.unpack_from(f"<{form}", content, end)
        position = end + struct.calcsize(form)
        yield before.decode("ascii", "replace"), float(value)


def _common(before: str, name: str) -> int:
    limit = min(len(before), len(name) - 1, _MAX_COMMON)
    return next((index for index in range(limit) if before[index] != name[index]), limit)


def _whole(text: str | None, otherwise: int) -> int:
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 6 else otherwise
