"""Framing and tables of the PNI binary protocol on the side of the module (TCM User Manual, chapter 7).

Byte count and CRC are always big endian; numbers in a payload follow the setting kBigEndian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum

from hil.devices.crc import crc16_1021
from hil.devices.timing import ReceiveBuffer

_OVERHEAD_BYTES = 5  # byte count, frame id, CRC
_MAX_COMMAND_BYTES = 270  # kSetFIRFilters with 32 taps, the longest command


class Frame(IntEnum):
    """Frame ids."""

    GET_MOD_INFO = 1
    MOD_INFO_RESP = 2
    SET_DATA_COMPONENTS = 3
    GET_DATA = 4
    DATA_RESP = 5
    SET_CONFIG = 6
    GET_CONFIG = 7
    CONFIG_RESP = 8
    SAVE = 9
    START_CAL = 10
    STOP_CAL = 11
    POWER_DOWN = 15
    SAVE_DONE = 16
    CAL_SAMPLE_COUNT = 17
    CAL_SCORE = 18
    SET_CONFIG_DONE = 19
    START_CONTINUOUS = 21
    STOP_CONTINUOUS = 22
    POWER_UP_DONE = 23
    SET_ACQ_PARAMS = 24
    GET_ACQ_PARAMS = 25
    SET_ACQ_PARAMS_DONE = 26
    ACQ_PARAMS_RESP = 27
    POWER_DOWN_DONE = 28


class Config(IntEnum):
    """Ids of the settings that affect the output."""

    DECLINATION = 1
    TRUE_NORTH = 2
    BIG_ENDIAN = 6
    POINTS = 12  # of a user calibration
    AUTOMATIC = 13  # sampling in a user calibration
    MILS = 15  # angles in 6400ths of a turn


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of the configuration table: format of the value as in struct, its range, its factory value."""

    code: str
    low: float
    high: float
    factory: float


SETTINGS: dict[int, Setting] = {
    Config.DECLINATION: Setting("f", -180.0, 180.0, 0.0),
    Config.TRUE_NORTH: Setting("B", 0, 1, 0),
    Config.BIG_ENDIAN: Setting("B", 0, 1, 1),
    10: Setting("B", 1, 16, 1),  # mounting reference
    Config.POINTS: Setting("I", 4, 32, 12),
    Config.AUTOMATIC: Setting("B", 0, 1, 1),
    Config.MILS: Setting("B", 0, 1, 0),
}


_POLLED_MODE = 1  # value of `mode`


@dataclass(frozen=True, slots=True)
class ModuleSettings:
    """Settings that kSave stores; a power cycle restores the stored ones."""

    components: tuple[int, ...] = ()
    config: dict[int, float] = field(default_factory=lambda: {key: row.factory for key, row in SETTINGS.items()})
    mode: int = _POLLED_MODE  # this and the next three are kSetAcqParams
    flush: int = 0  # the filter before each sample
    acquire_s: float = 0.0  # time between samples of the sensors
    interval_s: float = 0.0  # time between outputs
    is_continuous: bool = False

    def pack(self, codes: str, *values: float) -> bytes:
        """Encode numbers in the configured byte order; `codes` as in struct."""
        numbers = [value if code == "f" else int(value) for code, value in zip(codes, values, strict=True)]
        return struct.pack(self._order() + codes, *numbers)

    def unpack(self, codes: str, payload: bytes) -> tuple[float, ...] | None:
        """Decode numbers in the configured byte order; None for a wrong number of bytes."""
        order = self._order() + codes
        return struct.unpack(order, payload) if struct.calcsize(order) == len(payload) else None

    def _order(self) -> str:
        return ">" if self.config[Config.BIG_ENDIAN] else "<"


def pack_frame(frame: int, payload: bytes = b"") -> bytes:
    """Return a complete frame."""
    body = (len(payload) + _OVERHEAD_BYTES).to_bytes(2, "big") + bytes([frame]) + payload
    return body + crc16_1021(body).to_bytes(2, "big")


class FrameReader:
    """Finds frames in the bytes from the host and skips damaged frames."""

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._buffer = ReceiveBuffer(max_bytes=2 * _MAX_COMMAND_BYTES)

    def feed(self, now_s: float, data: bytes) -> list[tuple[int, bytes]]:
        """Add bytes and return (frame id, payload) of the frames that they complete."""
        self._buffer.append(now_s, data)
        buffer = self._buffer.data
        frames: list[tuple[int, bytes]] = []
        start = 0
        while len(buffer) - start >= _OVERHEAD_BYTES:
            count = int.from_bytes(buffer[start : start + 2], "big")
            if not _OVERHEAD_BYTES <= count <= _MAX_COMMAND_BYTES:
                start += 1
                continue
            if len(buffer) - start < count:
                break
            body = bytes(buffer[start : start + count - 2])
            check = buffer[start + count - 2 : start + count]
            if crc16_1021(body) == int.from_bytes(check, "big"):
                frames.append((body[2], body[3:]))
                start += count
            else:
                start += 1
        del buffer[:start]
        return frames

    def clear(self) -> None:
        """Discard an incomplete frame."""
        self._buffer.clear()
