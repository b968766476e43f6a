"""Parameters as files: component metadata for ground stations, and ArduPilot's packed list.

Source of the packed list: ArduPilot, libraries/AP_Filesystem/README.md.
"""

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
from firmware_py.link.wire.dialect import Message, encode_text, mavlink

DIRECTORY = "metadata"
ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
_PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER
_URI = f"mftp://{DIRECTORY}/"
_JSON_TYPES = {Kind.INTEGER: "Int32", Kind.REAL: "Float"}
# The small xz decoders of ground stations support only CHECK_CRC32 and a small dictionary. The files are compressed at
# each start: the highest preset would save only 300 bytes.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 2, "dict_size": 1 << 16}]

_MAGIC, _MAGIC_WITH_DEFAULTS = 0x671B, 0x671C
_HEADER = struct.Struct("<HHH")  # magic, number of parameters in the file, number of all; in uploads see `unpack`
# Each parameter: type and flags, lengths of common prefix and rest of the name, rest of the name, value.
_PACKED_TYPES = {Kind.INTEGER: (3, "i"), Kind.REAL: (4, "f")}
_FORMATS = {1: "b", 2: "h", 3: "i", 4: "f"}  # struct format by ArduPilot's type number
_HAS_DEFAULT = 0x10  # flag beside the type: the default follows the value


class Metadata:
    """Component metadata: the files by path, and the messages that refer to them."""

    def __init__(self, version: Version, autopilot: int) -> None:
        """Generate the files for a program version and an autopilot type (MAV_AUTOPILOT)."""
        self.autopilot = autopilot
        parameters, compressed = parameter_files(autopilot)
        general = _to_json(
            {
                "version": 1,
                "vendorName": "Rambler",
                "modelName": "Rambler",
                "firmwareVersion": f"{version.major}.{version.minor}.{version.patch}",
                "metadataTypes": [
                    {"type": _PARAMETER_TYPE, "uri": f"{_URI}parameter.json.xz", "fileCrc": mavlink_crc32(compressed)}
                ],
            }
        )
        self._general = _compress(general)
        self.files: Mapping[PathParts, bytes] = {
            (DIRECTORY, "general.json"): general,
            (DIRECTORY, "general.json.xz"): self._general,
            (DIRECTORY, "parameter.json"): parameters,
            (DIRECTORY, "parameter.json.xz"): compressed,
        }

    def message(self, t_s: float) -> Message:
        """Return COMPONENT_METADATA."""
        uri = encode_text(f"{_URI}general.json.xz", 100)
        return mavlink.mavlink_map[397](boot_ms(t_s), mavlink_crc32(self._general), uri)

    def information_message(self, t_s: float) -> Message:
        """Return COMPONENT_INFORMATION, which older stations request."""
        uri = encode_text(f"{_URI}general.json.xz", 100)
        return mavlink.mavlink_map[395](boot_ms(t_s), mavlink_crc32(self._general), uri, 0, b"")


@cache
def parameter_files(autopilot: int) -> tuple[bytes, bytes]:
    """Return parameter.json, plain and compressed; cached, since the table does not change."""
    parameters = _to_json({"version": 3, "parameters": [_describe(row, autopilot) for row in TABLE]})
    return parameters, _compress(parameters)


def parameter_json() -> str:
    """Return parameter.json as text."""
    return parameter_files(ARDUPILOT)[0].decode()


def declared_kind(row: Parameter, autopilot: int) -> Kind:
    """Return the type of a parameter that is declared to ground stations.

    Values are sent as floats. For ArduPilot, every station expects that. For other autopilots, many expect the bytes of
    an integer in the float field; therefore all parameters are declared REAL.
    """
    return row.kind if autopilot == ARDUPILOT else Kind.REAL


def _describe(row: Parameter, autopilot: int) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "name": row.name,
        "type": _JSON_TYPES[declared_kind(row, autopilot)],
        "shortDesc": row.text.split(":")[0].split(";")[0].split(". ")[0].rstrip("."),
        "longDesc": row.text,
        "default": _json_number(row, row.default),
        "min": _json_number(row, row.minimum),
        "max": _json_number(row, row.maximum),
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


def _json_number(row: Parameter, value: float) -> float | int:
    # Seven digits give the shortest decimal of a single-precision value: 0.1 instead of 0.10000000149011612.
    return int(value) if row.kind is Kind.INTEGER else float(f"{value:.7g}")


def _decimal_places(row: Parameter) -> int:
    """Return the number of decimals that shows four digits of the default, or of the minimum if the default is 0."""
    size = abs(row.default) or abs(row.minimum) or 1.0
    places = 0
    while size < 100.0 and places < 7:
        size *= 10.0
        places += 1
    return max(places, 1)


def _to_json(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, indent=1).encode("ascii")


def _compress(content: bytes) -> bytes:
    return lzma.compress(content, lzma.FORMAT_XZ, lzma.CHECK_CRC32, filters=_FILTERS)


def pack(values: ParameterSet, query: Mapping[str, str], autopilot: int) -> bytes:
    """Encode the list; the options in `query` are start, count and withdefaults, and invalid values are ignored.

    The types are those that PARAM_VALUE declares for this autopilot type, because ground stations store them.
    """
    start, count = _parse_count(query.get("start"), 0), _parse_count(query.get("count"), len(TABLE))
    with_defaults = _parse_count(query.get("withdefaults"), 0) != 0
    rows = range(start, min(start + count, len(TABLE)))
    encoded = [_HEADER.pack(_MAGIC_WITH_DEFAULTS if with_defaults else _MAGIC, len(rows), len(TABLE))]
    previous_name = ""
    for index in rows:
        row, value = TABLE[index], values.values()[index]
        type_number, format_code = _PACKED_TYPES[declared_kind(row, autopilot)]
        prefix = _prefix_length(previous_name, row.name)
        suffix = row.name[prefix:].encode("ascii")
        row_values = [value]
        if with_defaults and value != row.default:
            type_number |= _HAS_DEFAULT
            row_values.append(row.default)
        numbers = [int(number) if format_code == "i" else number for number in row_values]
        encoded.append(bytes((type_number, prefix | (len(suffix) - 1) << 4)) + suffix)
        encoded.append(struct.pack(f"<{len(numbers)}{format_code}", *numbers))
        previous_name = row.name
    return b"".join(encoded)


def unpack(content: bytes) -> dict[str, float]:
    """Return the checked values of an uploaded file by name; raise ParameterError if any is invalid.

    The third number of the header is the length of the file, as in uploads to ArduPilot.
    """
    if len(content) < _HEADER.size:
        raise ParameterError("file shorter than its header")
    magic, count, length = _HEADER.unpack_from(content)
    if magic != _MAGIC:
        raise ParameterError(f"begins with {magic:#06x} instead of {_MAGIC:#06x}")
    if length != len(content):
        raise ParameterError(f"{len(content)} of {length} bytes received")
    values: dict[str, float] = {}
    row_count = 0
    for name, value in _decode_rows(content):
        index = INDEX.get(name)
        if index is None:
            raise ParameterError(f"unknown parameter {name[:16]!r}")
        row = TABLE[index]
        if row.read_only:
            raise ParameterError(f"{name} is read-only")
        values[name] = row.check(value)
        row_count += 1
    if row_count != count:
        raise ParameterError(f"{row_count} parameters instead of {count}")
    return values


def _decode_rows(content: bytes) -> Iterator[tuple[str, float]]:
    position, name = _HEADER.size, b""
    while position < len(content):
        if content[position] == 0:
            position += 1  # padding
            continue
        format_code = _FORMATS.get(content[position])
        if format_code is None or position + 1 >= len(content):
            raise ParameterError(f"no valid parameter at byte {position}")
        lengths = content[position + 1]
        start = position + 2
        end = start + (lengths >> 4) + 1
        if (lengths & 0x0F) > len(name) or end + struct.calcsize(format_code) > len(content):
            raise ParameterError(f"the parameter at byte {position} is cut off")
        name = name[: lengths & 0x0F] + content[start:end]
        (value,) = struct.unpack_from(f"<{format_code}", content, end)
        position = end + struct.calcsize(format_code)
        yield name.decode("ascii", "replace"), float(value)


def _prefix_length(previous: str, name: str) -> int:
    """Return the length of the common prefix of two names, at most 15; a suffix of one character or more remains."""
    limit = min(len(previous), len(name) - 1)
    return next((index for index in range(limit) if previous[index] != name[index]), limit)


def _parse_count(text: str | None, default: int) -> int:
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 6 else default
