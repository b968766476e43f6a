"""Messages of NMEA 2000 for the emulators: fields as texts of bits, CAN frames, and the forms of gateways.

Written from the field lists of the makers (Maretron SSC200 and GPS100 user manuals, Garmin 190-00891-00), without the
code of the driver. A message is a text of bits, the lowest bit of each field first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

Bits = str

TRUE, MAGNETIC, UNKNOWN_REFERENCE = 0, 1, 3  # references of a direction
DLE, STX, ETX = b"\x10", b"\x02", b"\x03"
RECEIVED, GATEWAY_COMMAND, BUS_COMMAND = 0x93, 0xA1, 0x94  # kinds of Actisense frames


def unsigned(value: float | None, width: int, resolution: float = 1.0) -> Bits:
    """Return an unsigned field; None is "not available"."""
    number = (1 << width) - 1 if value is None else round(value / resolution)
    return f"{number:0{width}b}"[::-1]


def signed(value: float | None, width: int, resolution: float = 1.0) -> Bits:
    """Return a field in two's complement; None is "not available"."""
    number = (1 << (width - 1)) - 1 if value is None else round(value / resolution)
    return "".join("1" if number >> bit & 1 else "0" for bit in range(width))


def bearing(angle_rad: float | None) -> Bits:
    """Return an angle of 0 to 360 degrees."""
    steps = None if angle_rad is None else round(angle_rad % (2.0 * math.pi) * 1e4)
    return unsigned(steps, 16)


def text(value: str, length: int) -> Bits:
    """Return a text of a fixed number of bytes, filled with @."""
    return "".join(unsigned(byte, 8) for byte in value.encode("ascii").ljust(length, b"@")[:length])


def to_bytes(bits: Bits, size: int = 8) -> bytes:
    """Return the bytes of a message; missing bits up to `size` bytes are reserved, that is 1."""
    padded = bits + "1" * (8 * size - len(bits))
    return bytes(int(padded[start : start + 8][::-1], 2) for start in range(0, len(padded), 8))


def heading(
    angle_rad: float | None,
    reference: int,
    *,
    deviation_rad: float | None = None,
    variation_rad: float | None = None,
    sequence: int | None = None,
) -> bytes:
    """Return PGN 127250; deviation and variation are positive to the east."""
    corrections = signed(deviation_rad, 16, 1e-4) + signed(variation_rad, 16, 1e-4)
    return to_bytes(unsigned(sequence, 8) + bearing(angle_rad) + corrections + unsigned(reference, 2))


def rate_of_turn(rate_rad_s: float | None) -> bytes:
    """Return PGN 127251; the unit is 1/32 microradian per second."""
    return to_bytes(unsigned(None, 8) + signed(rate_rad_s, 32, 1e-6 / 32.0))


def attitude(roll_rad: float | None, pitch_rad: float | None, yaw_rad: float | None = None) -> bytes:
    """Return PGN 127257."""
    angles = (signed(angle, 16, 1e-4) for angle in (yaw_rad, pitch_rad, roll_rad))
    return to_bytes(unsigned(None, 8) + "".join(angles))


def rudder(angle_rad: float | None, instance: int = 0) -> bytes:
    """Return PGN 127245."""
    order = "111" + "11111" + signed(None, 16)  # direction and angle order are not available
    return to_bytes(unsigned(instance, 8) + order + signed(angle_rad, 16, 1e-4))


def depth(depth_m: float | None, offset_m: float | None = None) -> bytes:
    """Return PGN 128267; the depth is below the transducer."""
    return to_bytes(unsigned(None, 8) + unsigned(depth_m, 32, 0.01) + signed(offset_m, 16, 0.001))


def wind(speed_m_s: float | None, angle_rad: float | None, reference: int) -> bytes:
    """Return PGN 130306; the angle is that from which the wind comes, reference 2: apparent wind."""
    return to_bytes(unsigned(None, 8) + unsigned(speed_m_s, 16, 0.01) + bearing(angle_rad) + unsigned(reference, 3))


def position(latitude_deg: float | None, longitude_deg: float | None) -> bytes:
    """Return PGN 129025."""
    return to_bytes(signed(latitude_deg, 32, 1e-7) + signed(longitude_deg, 32, 1e-7))


def course(course_rad: float | None, speed_m_s: float | None, reference: int = TRUE) -> bytes:
    """Return PGN 129026."""
    return to_bytes(
        unsigned(None, 8) + unsigned(reference, 2) + "1" * 6 + bearing(course_rad) + unsigned(speed_m_s, 16, 0.01)
    )


def clock(utc_s: float | None) -> Bits:
    """Return date and time of day."""
    if utc_s is None:
        return unsigned(None, 16) + unsigned(None, 32)
    days, time_s = divmod(utc_s, 86_400.0)
    return unsigned(days, 16) + unsigned(int(time_s * 1e4), 32)


def system_time(utc_s: float | None) -> bytes:
    """Return PGN 126992, with a GPS as source."""
    return to_bytes(unsigned(None, 8) + "0000" + "1111" + clock(utc_s))


def gnss_position(
    latitude_deg: float | None,
    longitude_deg: float | None,
    utc_s: float | None,
    *,
    method: int = 1,
    altitude_m: float | None = 0.0,
    satellites: int = 9,
    hdop: float | None = 0.9,
    integrity: int = 0,
) -> bytes:
    """Return PGN 129029 without reference stations; method 1: GNSS fix, integrity 0: not checked."""
    place = signed(latitude_deg, 64, 1e-16) + signed(longitude_deg, 64, 1e-16) + signed(altitude_m, 64, 1e-6)
    quality = "0000" + unsigned(method, 4) + unsigned(integrity, 2) + "1" * 6 + unsigned(satellites, 8)
    dilution = signed(hdop, 16, 0.01) + signed(None, 16) + signed(None, 32) + unsigned(0, 8)
    return to_bytes(unsigned(None, 8) + clock(utc_s) + place + quality + dilution, 43)


def vessel_a(
    mmsi: int,
    latitude_deg: float | None,
    longitude_deg: float | None,
    speed_m_s: float | None,
    course_rad: float | None,
    *,
    heading_rad: float | None = None,
    turn_rad_s: float | None = None,
    status: int = 15,
    transceiver: int = 0,
) -> bytes:
    """Return PGN 129038, the position report of class A; status 15: undefined, transceiver 0: channel A."""
    return to_bytes(
        _vessel(1, mmsi, latitude_deg, longitude_deg)
        + bearing(course_rad)
        + unsigned(speed_m_s, 16, 0.01)
        + "0" * 19
        + unsigned(transceiver, 5)
        + bearing(heading_rad)
        + signed(turn_rad_s, 16, 1e-3 / 32.0)
        + unsigned(status, 4),
        28,
    )


def vessel_b(
    mmsi: int,
    latitude_deg: float | None,
    longitude_deg: float | None,
    speed_m_s: float | None,
    course_rad: float | None,
    *,
    transceiver: int = 0,
) -> bytes:
    """Return PGN 129039, the position report of class B; transceiver 0: channel A."""
    return to_bytes(
        _vessel(18, mmsi, latitude_deg, longitude_deg)
        + bearing(course_rad)
        + unsigned(speed_m_s, 16, 0.01)
        + "0" * 19
        + unsigned(transceiver, 5)
        + bearing(None)
        + "0" * 16,
        27,
    )


def _vessel(message_type: int, mmsi: int, latitude_deg: float | None, longitude_deg: float | None) -> Bits:
    return (
        unsigned(message_type, 6)  # AIS message type
        + "00"
        + unsigned(mmsi, 32)
        + signed(longitude_deg, 32, 1e-7)
        + signed(latitude_deg, 32, 1e-7)
        + "1"  # accurate
        + "0"
        + unsigned(0, 6)
    )


def static_a(mmsi: int, name: str, call_sign: str, ship_type: int, sizes_m: tuple[float, float, float, float]) -> bytes:
    """Return PGN 129794; `sizes_m`: length, beam, distance of the antenna from starboard and from bow."""
    return to_bytes(
        unsigned(5, 6)
        + "00"
        + unsigned(mmsi, 32)
        + unsigned(None, 32)
        + text(call_sign, 7)
        + text(name, 20)
        + unsigned(ship_type, 8)
        + "".join(unsigned(size_m, 16, 0.1) for size_m in sizes_m)
        + clock(None)
        + unsigned(None, 16)
        + text("", 20)
        + "00"
        + "1000"
        + "0"
        + "0"
        + unsigned(0, 5),
        76,
    )


def identifier(pgn: int, source: int, priority: int = 2, destination: int = 255) -> int:
    """Return the CAN identifier of 29 bits."""
    group = pgn if pgn // 256 % 256 >= 240 else pgn + destination
    return priority * 2**26 + group * 256 + source


def frames(data: bytes, sequence: int) -> Iterator[bytes]:
    """Yield the data of the CAN frames of a fast packet, the last one filled with 255."""
    stream = bytes([len(data)]) + data
    for number in range(math.ceil(len(stream) / 7)):
        yield bytes([sequence % 8 * 32 + number]) + stream[7 * number : 7 * number + 7].ljust(7, b"\xff")


def actisense_frame(command: int, data: bytes) -> bytes:
    """Return a frame of an Actisense gateway: a DLE in it is doubled, and its bytes add up to 0."""
    content = bytes([command, len(data)]) + data
    content += bytes([-sum(content) % 256])
    return DLE + STX + content.replace(DLE, DLE + DLE) + DLE + ETX


def actisense_message(pgn: int, source: int, data: bytes, *, priority: int = 2, t_ms: int = 0) -> bytes:
    """Return a received message as an Actisense gateway sends it."""
    group = bytes([pgn & 0xFF, pgn >> 8 & 0xFF, pgn >> 16])
    addresses, time = bytes([255, source]), (t_ms % 2**32).to_bytes(4, "little")
    return actisense_frame(RECEIVED, bytes([priority]) + group + addresses + time + bytes([len(data)]) + data)


def raw_line(pgn: int, source: int, data: bytes, *, t_s: float = 0.0, direction: str = "R", priority: int = 2) -> bytes:
    """Return a CAN frame as a line of Yacht Devices RAW."""
    minutes, t_ms = divmod(round(1e3 * t_s) % 86_400_000, 60_000)
    clock_text = f"{minutes // 60:02d}:{minutes % 60:02d}:{t_ms // 1000:02d}.{t_ms % 1000:03d}"
    values = " ".join(f"{byte:02X}" for byte in data)
    return f"{clock_text} {direction} {identifier(pgn, source, priority):08X} {values}\r\n".encode("ascii")
