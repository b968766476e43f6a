"""Drivers of sensors and servos on a line with any input, and decoding of captures."""

import functools
import json
import math
import operator
import struct
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.actuator import dynamixel_frames, feetech_protocol, volz_frames
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.devices import CAPTURE_FORMATS, SECTIONS, calibrator_of, decode
from firmware_py.sensors import mti_protocol, pni_protocol
from firmware_py.sensors.decode import format_text
from firmware_py.sensors.nmea2000_table import LAYOUTS
from fuzz.target import Target, check_finite, check_line, records

# Bits of the kind of a record.
ADD_FRAMING, LINE_LOST, SILENCE, LINE_FULL, CALIBRATE = 0x01, 0x02, 0x04, 0x08, 0x10
STEP_S, SILENCE_S = 0.05, 2.0
MAX_BUFFERED_BYTES = 16_384  # bytes in the buffers of a driver
MAX_UTC_S = 5e9  # in 2128; years of two digits and clocks of 32 bits end earlier


def frame_nmea(body, start=b"$"):
    return b"%s%s*%02X\r\n" % (start, body, functools.reduce(operator.xor, body, 0))


def frame_ubx(body):
    summed_bytes = body[:2].ljust(2, b"\0") + struct.pack("<H", len(body[2:])) + body[2:]
    sum_a = sum_b = 0
    for byte in summed_bytes:
        sum_a = sum_a + byte & 0xFF
        sum_b = sum_b + sum_a & 0xFF
    return b"\xb5\x62" + summed_bytes + bytes((sum_a, sum_b))


def encode_numbered(encode, body):
    """Frame a body; its first byte is the number of the message."""
    return encode(body[0] if body else 0, body[1:])


def frame_rion(body):
    """Frame a body, whose first bytes choose identifier and command, and are then data."""
    content = body.ljust(10, b"\0")
    command, size = ((0x84, 9), (0x84, 10), (0x87, 2), (0x8C, 1))[content[0] >> 1 & 3]
    summed_bytes = bytes((4 + size, 0, command)) + content[1 : 1 + size].ljust(size, b"\0")
    return (b"h", b"w")[content[0] & 1] + summed_bytes + bytes([sum(summed_bytes) & 0xFF])


def frame_witmotion(body):
    """Frame a body after a packet, without which a packet is not used."""
    packets = [
        b"\x55\x50".ljust(10, b"\0"),
        b"\x55" + bytes([0x50 | (body[0] if body else 0) & 0xF]) + body[1:9].ljust(8, b"\0"),
    ]
    return b"".join(packet + bytes([sum(packet) & 0xFF]) for packet in packets)


def frame_dynamixel(body):
    return dynamixel_frames.instruction(1, dynamixel_frames.STATUS, body)


def frame_volz(body):
    code, argument = struct.unpack("<BH", body[:3].ljust(3, b"\0"))
    return volz_frames.request(code, 1, argument)


def frame_feetech(body):
    """Frame a body whose first byte is the status; a longer one is cut or filled to the length of a state."""
    data = body[:1].ljust(1, b"\0") + (body[1:].ljust(31, b"\0")[:46] if len(body) > 1 else b"")
    return feetech_protocol.instruction(1, *data)


def frame_ais(body):
    """Frame bytes as an AIS message of one sentence; the payload has only characters of the armouring."""
    payload = b"".join(ARMOUR[byte & 63 : (byte & 63) + 1] for byte in body)
    return frame_nmea(b"AIVDM,1,1,,A,%s,0" % payload, b"!")


ARMOUR = b"0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw"


def frame_actisense(body):
    """Frame bytes as an Actisense message: the first byte selects the PGN, the second the source."""
    pgn = (*LAYOUTS, 60928)[body[0] % (len(LAYOUTS) + 1)] if body else 0
    source, data = body[1:2] or b"\0", body[2:225]
    content = b"\2" + pgn.to_bytes(3, "little") + b"\xff" + source + bytes(4) + bytes([len(data)]) + data
    content = bytes([0x93, len(content)]) + content
    content += bytes([-sum(content) & 0xFF])
    return b"\x10\x02" + content.replace(b"\x10", b"\x10\x10") + b"\x10\x03"


def frame_vedirect(body):
    data = body + b"\r\nChecksum\t"
    return data + bytes([-sum(data) & 0xFF])


def frame_bno08x_rvc(body):
    content = body[:16].ljust(16, b"\0")
    return b"\xaa\xaa" + content + bytes([sum(content) & 0xFF])


def frame_mavlink(body):
    """Frame a body as MAVLink 2 after two heartbeats of the board; its first byte selects the message."""
    number = MAVLINK_NUMBERS[(body[0] if body else 0) % len(MAVLINK_NUMBERS)]
    payload = body[1:] or b"\0"
    covered = bytes((len(payload), 0, 0, 0, 1, 1)) + number.to_bytes(3, "little") + payload
    checksum = dialect.x25crc(covered + bytes((dialect.mavlink_map[number].crc_extra,))).crc
    return MAVLINK_HEARTBEAT * 2 + b"\xfd" + covered + checksum.to_bytes(2, "little")


MAVLINK_NUMBERS = (0, 1, 2, 24, 30, 33, 77, 147, 193, 230)
MAVLINK_HEARTBEAT = bytes.fromhex("fe094e0101000000000002035104031c7f")

FRAMINGS = {
    "nmea": frame_nmea,
    "pni_tcm": partial(encode_numbered, pni_protocol.encode),
    "mti": partial(encode_numbered, mti_protocol.encode),
    "rion": frame_rion,
    "witmotion": frame_witmotion,
    "bno08x_rvc": frame_bno08x_rvc,
    "ubx": frame_ubx,
    "dynamixel": frame_dynamixel,
    "volz": frame_volz,
    "feetech": frame_feetech,
    "vedirect": frame_vedirect,
    "maestro": bytes,
    "pwm": bytes,
    "ais": frame_ais,
    "mavlink": frame_mavlink,
    "nmea2000": frame_actisense,
}


class Line:
    """A line with scripted input that may be unplugged."""

    name, baud = "/dev/fuzz", 57600

    def __init__(self):
        self.inbox = bytearray()
        self.openings, self.connected, self.full = 1, True, False

    def fileno(self):
        return 7 if self.connected else -1

    def read(self):
        data = bytes(self.inbox[:4096]) if self.connected else b""
        del self.inbox[:4096]
        return data

    def write(self, data):
        assert 0 < len(data) <= 64
        return self.connected and not self.full


def buffered_bytes(value, visited_ids):
    """Return the number of bytes in all buffers of an object and of its attributes."""
    if id(value) in visited_ids or isinstance(value, type):
        return 0
    visited_ids.add(id(value))
    if isinstance(value, bytes | bytearray):
        return len(value)
    if isinstance(value, dict):
        return sum(buffered_bytes(item, visited_ids) for item in value.values())
    if isinstance(value, list | tuple | set) or type(value).__name__ == "deque":
        return 16 * len(value) + sum(buffered_bytes(item, visited_ids) for item in value)
    if not type(value).__module__.startswith("firmware_py"):
        return 0
    slots = (name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ()))
    slot_values = {name: getattr(value, name) for name in slots if hasattr(value, name)}
    return buffered_bytes({**slot_values, **getattr(value, "__dict__", {})}, visited_ids)


RANGES = {
    "heading_rad": (0.0, math.tau),
    "course_over_ground_rad": (0.0, math.tau),
    "latitude_rad": (-math.pi / 2, math.pi / 2),
    "longitude_rad": (-math.pi, math.pi),
    "variation_rad": (-math.pi, math.pi),
    "roll_rad": (-math.pi, math.pi),
    "pitch_rad": (-math.pi, math.pi),
    "speed_over_ground_m_s": (0.0, 1e4),
    "hdop": (0.0, 1e3),
    "satellites": (0, 255),
    "utc_s": (0.0, MAX_UTC_S),
    "charge": (0.0, 1.0),
    "solar_w": (0.0, 1e5),
    "speed_m_s": (0.0, 53.0),
    "course_rad": (0.0, math.tau),
    "turn_rad_s": (-0.3, 0.3),
    "rudder_rad": (-math.pi / 2, math.pi / 2),
    "mmsi": (1, 999_999_999),
    "wind_m_s": (0.0, 120.0),
    "angle_rad": (0.0, math.tau),
    "depth_m": (1e-9, 12_200.0),
    "transducer_m": (0.0, 100.0),
}


def check_sample(sample, now_s):
    check_finite(sample)
    assert 0.0 <= sample.t_s <= now_s
    for name, (low, high) in RANGES.items():
        value = getattr(sample, name, None)
        assert value is None or low <= value <= high, f"{name} {value}"
    assert (getattr(sample, "heading_rad", 0.0) or 0.0) < math.tau


def run_driver(section, name, data):
    """Feed a driver with the records, one per poll, and check samples and health."""
    driver, framing, line = (
        SECTIONS[section][name],
        FRAMINGS["ais" if (section, name) == ("ais", "nmea") else name],
        Line(),
    )
    device = driver.make(line, driver.options())
    calibrator = calibrator_of(name, device) if section == "compass" else None
    message_count, now_s = 0, 0.0
    for kind, body in records(data):
        now_s += SILENCE_S if kind & SILENCE else STEP_S
        was_lost, line.connected, line.full = not line.connected, not kind & LINE_LOST, bool(kind & LINE_FULL)
        line.openings += was_lost and line.connected
        if line.connected:
            line.inbox += framing(body) if kind & ADD_FRAMING else body
        if section == "rudder":
            device.command(RudderCommand((len(body) - 32) / 32.0, torque_on=not kind & CALIBRATE), now_s)
        elif kind & CALIBRATE and calibrator is not None:
            (calibrator.calibrate(now_s) and line.full) or not line.full or calibrator.cancel()
        device.receive(now_s)
        for sample in device.poll():
            check_sample(sample, now_s)
        health = device.health(now_s)
        assert health.state in DeviceState
        assert health.accepted + health.rejected >= message_count
        message_count = health.accepted + health.rejected
        if health.text:
            check_line(health.text)
        if calibrator is not None:
            progress = calibrator.calibration()
            assert 0 <= progress.percent <= 100
            assert not progress.text or progress.text.isprintable()
    assert buffered_bytes(device, {id(line)}) <= MAX_BUFFERED_BYTES


def read_capture(data):
    """Decode a capture like `rambler decode`; the first byte selects the format."""
    names = sorted(CAPTURE_FORMATS)
    for result in decode(names[data[0] % len(names)], data[1:]) if data else ():
        json.dumps(result, allow_nan=False)
        assert result["line"] >= 1
        assert format_text(result).isprintable()


NMEA_WORDS = tuple(
    word.encode()
    for word in (
        "HCHDG,", "HEHDT,", "HCHDM,", "HETHS,", "PASHR,", "TIROT,", "GPRMC,", "GNGGA,", "GNGNS,", "GPGLL,", "GPVTG,",
        "IIXDR,", "IIRSA,", "WIVWR,", "WIMWV,", "WIMWD,", "WIVWT,", "SDDPT,", "SDDBT,", "SDDBS,", "SDDBK,",
        "A,1.2,D,PTCH", "P,1.0164,B,STNP", ",C,23.3,C,0",
        ",A", ",V", ",N,", ",S,", ",E,", ",W,", ",T,", ",M", "-0.0", "359.99", "360", "1e9", ".",
        "235960", "310299", "290224", "9000.000", "18000.000", "*", "\\s:x*00\\", "$", "!",
    )
)  # fmt: skip
VEDIRECT_WORDS = (
    b"\r\nV\t12800", b"\r\nI\t-310", b"\r\nSOC\t876", b"\r\nPPV\t20", b"\r\nIL\t300", b"\r\nT\t---", b"\r\nERR\t17",
    b"\r\nAlarm\tON", b"\r\nAR\t1", b"\r\nChecksum\t", b":7F0ED0071\n", b"\t", b"-", b"1_0",
)  # fmt: skip
AIS_WORDS = (
    b"!AIVDM,1,1,,A,", b"!AIVDM,2,1,3,B,", b"!AIVDM,2,2,3,B,", b"!AIVDO,1,1,,,", b",0*", b",2*", b"\\g:1-2-3*00\\",
    b"15M67FC000G?ufbE`FepT@3n00Sa", b"B3KLehP0B@LTN6`Vl;rrBE063P06", b"H3KLehdt00000000?6ekkjm00000",
)  # fmt: skip
NMEA2000_WORDS = (
    b"\x10\x02\x93", b"\x10\x03", b"\x10\x10", b"\x12\xf1\x01", b"\x13\xf1\x01", b"\x05\xf8\x01", b"\xff\x7f",
)  # fmt: skip
WORDS = {"nmea": NMEA_WORDS, "vedirect": VEDIRECT_WORDS, "nmea2000": NMEA2000_WORDS}
TARGETS = {
    f"{section}_{name}": Target(
        partial(run_driver, section, name),
        words=AIS_WORDS if (section, name) == ("ais", "nmea") else WORDS.get(name, ()),
    )
    for section, drivers in SECTIONS.items()
    if not section.endswith("_b")  # these have the same drivers
    for name in drivers
} | {"capture": Target(read_capture, words=NMEA_WORDS)}
