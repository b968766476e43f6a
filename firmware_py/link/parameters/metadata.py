"""Component metadata: what the parameters mean, for ground stations to show.

Two files, each also compressed: general.json names the other, parameter.json tells of each row of the parameter table.
Stations keep them by checksum, so the same table makes the same bytes. Source: the MAVLink guide,
services/component_information, and the published schemas.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Mapping
from functools import cache
from typing import Any

from firmware_py.common.parameter_row import Kind, Parameter
from firmware_py.common.parameter_table import GROUPS, TABLE
from firmware_py.link.files.area import Parts, mavlink_crc32
from firmware_py.link.telemetry.context_fields import boot_ms
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.dialect import Message, mavlink, text_of

DIRECTORY = "metadata"
ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
_PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER
_URI = f"mftp://{DIRECTORY}/"
_TYPES = {Kind.INTEGER: "Int32", Kind.REAL: "Float"}
# The stations' small decoders know this check and no other. Dictionary and effort are small for this computer's sake,
# which does it at each start: the most effort would save 300 bytes.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 2, "dict_size": 1 << 16}]


class Metadata:
    """The files, by path, and the messages that point to them."""

    def __init__(self, version: Version, autopilot: int) -> None:
        """Make the files of this version, for a boat that says it is this autopilot (MAV_AUTOPILOT)."""
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
        self.files: Mapping[Parts, bytes] = {
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
        """Return COMPONENT_INFORMATION, which older stations ask for."""
        uri = text_of(f"{_URI}general.json.xz", 100)
        return mavlink.mavlink_map[395](boot_ms(t_s), mavlink_crc32(self._general), uri, 0, b"")


@cache
def parameter_files(autopilot: int) -> tuple[bytes, bytes]:
    """Return parameter.json, plain and compressed; made once, since the table does not change."""
    parameters = _text({"version": 3, "parameters": [_parameter(row, autopilot) for row in TABLE]})
    return parameters, _compressed(parameters)


def parameter_json() -> str:
    """Return parameter.json as text."""
    return parameter_files(ARDUPILOT)[0].decode()


def declared_kind(row: Parameter, autopilot: int) -> Kind:
    """Return the type that a parameter is said to have.

    Its value travels as a float. Of ArduPilot every station knows that; of others many take an integer for its bytes
    in the field of a float, and so there is none.
    """
    return row.kind if autopilot == ARDUPILOT else Kind.REAL


def _parameter(row: Parameter, autopilot: int) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "name": row.name,
        "type": _TYPES[declared_kind(row, autopilot)],
        "shortDesc": row.text.split(":")[0].split(";")[0].split(". ")[0].rstrip("."),
        "longDesc": row.text,
        "default": _number(row, row.default),
        "min": _number(row, row.minimum),
        "max": _number(row, row.maximum),
        "group": GROUPS.get(row.name.split("_")[0], "Other"),
        "category": "Standard",
    }
    if row.unit:
        shown["units"] = row.unit
    if declared_kind(row, autopilot) is Kind.REAL:
        shown["decimalPlaces"] = _decimal_places(row) if row.kind is Kind.REAL else 0
    if row.choices is not None:
        shown["values"] = [{"value": number, "description": text} for number, text in row.choices.items()]
    if row.reboot:
        shown["rebootRequired"] = True
    if row.read_only:
        shown["readOnly"] = True
        shown["volatile"] = True
    return shown


def _number(row: Parameter, value: float) -> float | int:
    # The shortest decimal of a single: 0.1, not 0.10000000149011612.
    return int(value) if row.kind is Kind.INTEGER else float(f"{value:.7g}")


def _decimal_places(row: Parameter) -> int:
    """Return how many decimals a value needs: four digits of the default, or of the least value that is not 0."""
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
