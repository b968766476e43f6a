"""MAVLink dialect: the message classes of pymavlink and messages that it lacks.

The dialect module is imported directly, since mavutil would cost 0.2 s and 30 MB. `common` of pymavlink 2.4.50 is older
than the published definitions. This module adds the missing messages of the autopilot, with the checksum seeds that
the generator of pymavlink computes from the published XML (a test compares them).
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import common as mavlink

Message: TypeAlias = Any  # the message classes of pymavlink are untyped

__all__ = ["ADDITIONS", "Addition", "Message", "encode_text", "mavlink", "payload_of_addition"]


class Addition(NamedTuple):
    """Message that pymavlink lacks, or defines without its extension fields."""

    name: str
    number: int
    seed: int  # crc_extra
    layout: str  # struct format of the payload
    wire: tuple[str, ...]  # field names in the order of the payload
    fields: tuple[str, ...]  # field names in the order of the definition


_VARIANCE_FIELDS = tuple(f"{name}_variance" for name in ("velocity", "pos_horiz", "pos_vert", "compass", "terrain_alt"))
_WATER_DEPTH_FIELDS = ("lat", "lng", "alt", "roll", "pitch", "yaw", "distance", "temperature")
ADDITIONS = (
    Addition(
        "MISSION_CURRENT",
        42,
        28,
        "<HHBBIII",
        ("seq", "total", "mission_state", "mission_mode", "mission_id", "fence_id", "rally_points_id"),
        ("seq", "total", "mission_state", "mission_mode", "mission_id", "fence_id", "rally_points_id"),
    ),
    Addition(
        "MISSION_COUNT",
        44,
        221,
        "<HBBBI",
        ("count", "target_system", "target_component", "mission_type", "opaque_id"),
        ("target_system", "target_component", "count", "mission_type", "opaque_id"),
    ),
    Addition(
        "MISSION_ACK",
        47,
        153,
        "<BBBBI",
        ("target_system", "target_component", "type", "mission_type", "opaque_id"),
        ("target_system", "target_component", "type", "mission_type", "opaque_id"),
    ),
    Addition(
        "COMMAND_CANCEL",
        80,
        14,
        "<HBB",
        ("command", "target_system", "target_component"),
        ("target_system", "target_component", "command"),
    ),
    Addition(
        "TIMESYNC",
        111,
        34,
        "<qqBB",
        ("tc1", "ts1", "target_system", "target_component"),
        ("tc1", "ts1", "target_system", "target_component"),
    ),
    Addition(  # of ardupilotmega's definitions
        "MAG_CAL_PROGRESS",
        191,
        92,
        "<fffBBBBB10s",
        (
            *("direction_x", "direction_y", "direction_z", "compass_id", "cal_mask", "cal_status", "attempt"),
            *("completion_pct", "completion_mask"),
        ),
        (
            *("compass_id", "cal_mask", "cal_status", "attempt", "completion_pct", "completion_mask"),
            *("direction_x", "direction_y", "direction_z"),
        ),
    ),
    Addition(  # of ardupilotmega's definitions
        "EKF_STATUS_REPORT",
        193,
        71,
        "<fffffHf",
        (*_VARIANCE_FIELDS, "flags", "airspeed_variance"),
        ("flags", *_VARIANCE_FIELDS, "airspeed_variance"),
    ),
    Addition(
        "PROTOCOL_VERSION",
        300,
        217,
        "<HHH8s8s",
        ("version", "min_version", "max_version", "spec_version_hash", "library_version_hash"),
        ("version", "min_version", "max_version", "spec_version_hash", "library_version_hash"),
    ),
    Addition(
        "COMPONENT_INFORMATION",
        395,
        0,
        "<III100s100s",
        (
            "time_boot_ms",
            "general_metadata_file_crc",
            "peripherals_metadata_file_crc",
            "general_metadata_uri",
            "peripherals_metadata_uri",
        ),
        (
            "time_boot_ms",
            "general_metadata_file_crc",
            "general_metadata_uri",
            "peripherals_metadata_file_crc",
            "peripherals_metadata_uri",
        ),
    ),
    Addition(
        "COMPONENT_METADATA",
        397,
        182,
        "<II100s",
        ("time_boot_ms", "file_crc", "uri"),
        ("time_boot_ms", "file_crc", "uri"),
    ),
    Addition(
        "AVAILABLE_MODES",
        435,
        134,
        "<IIBBB35s",
        ("custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name"),
        ("number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name"),
    ),
    Addition(
        "CURRENT_MODE",
        436,
        193,
        "<IIB",
        ("custom_mode", "intended_custom_mode", "standard_mode"),
        ("standard_mode", "custom_mode", "intended_custom_mode"),
    ),
    Addition("AVAILABLE_MODES_MONITOR", 437, 30, "<B", ("seq",), ("seq",)),
    Addition(  # of ardupilotmega's definitions
        "WATER_DEPTH",
        11038,
        47,
        "<IiiffffffBB",
        ("time_boot_ms", *_WATER_DEPTH_FIELDS, "id", "healthy"),
        ("time_boot_ms", "id", "healthy", *_WATER_DEPTH_FIELDS),
    ),
)


def _pack_payload(row: Addition, message: Message) -> bytes:
    return struct.pack(row.layout, *(getattr(message, name) for name in row.wire))


def _message_class(row: Addition) -> Any:
    """Create a message class with the interface of the generated classes of pymavlink."""

    def initialise(self: Any, *values: object) -> None:
        mavlink.MAVLink_message.__init__(self, row.number, row.name)
        self._fieldnames = list(row.fields)
        for name, value in zip(row.fields, values, strict=True):
            setattr(self, name, value)

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:  # noqa: FBT001, FBT002 - pymavlink's signature
        return bytes(self._pack(mav, row.seed, _pack_payload(row, self), force_mavlink1=force_mavlink1))

    attributes = {
        "id": row.number,
        "msgname": row.name,
        "fieldnames": list(row.fields),
        "ordered_fieldnames": list(row.wire),
        "orders": [row.wire.index(name) for name in row.fields],
        "lengths": [1] * len(row.fields),
        "array_lengths": [0] * len(row.fields),
        "crc_extra": row.seed,
        "unpacker": struct.Struct(row.layout),
        "__init__": initialise,
        "pack": pack,
    }
    return type(f"MAVLink_{row.name.lower()}_message", (mavlink.MAVLink_message,), attributes)


for _row in ADDITIONS:
    mavlink.mavlink_map[_row.number] = _message_class(_row)  # the table of the decoder of pymavlink


_ADDITION_OF_NUMBER = {row.number: row for row in ADDITIONS}


def payload_of_addition(message: Message) -> bytes | None:
    """Return the payload of a message of ADDITIONS; None for a message of pymavlink."""
    row = _ADDITION_OF_NUMBER.get(type(message).id)
    return None if row is None else _pack_payload(row, message)


def release_unused_attributes() -> None:
    """Free 1.5 MiB of pymavlink: texts of enumerations and unused methods."""
    mavlink.enums.clear()
    for name in [name for name in vars(mavlink.MAVLink) if name.endswith(("_encode", "_send"))]:
        delattr(mavlink.MAVLink, name)


def encode_text(text: str, length: int) -> bytes:
    """Encode a text as a MAVLink char field: ASCII with ? for other characters, truncated to `length` bytes."""
    return text.encode("ascii", "replace")[:length]
