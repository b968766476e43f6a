"""The emulated bus against documented messages, without the code of the driver."""

import math

import numpy as np
import pytest

from hil.devices import nmea2000_frames as n2k
from hil.devices.nmea2000 import COMPASS, SECOND_COMPASS, START_COMMAND, Nmea2000Emulator


class Boat:
    def __init__(self, heading_deg=100.0):
        self.heading_deg = heading_deg

    def heading_rad(self):
        return math.radians(self.heading_deg)

    def yaw_rate_rad_s(self):
        return 0.01

    def latitude_deg(self):
        return 50.0

    def longitude_deg(self):
        return -3.0

    def speed_over_ground_m_s(self):
        return 0.5

    def course_over_ground_rad(self):
        return 1.0

    def utc_s(self):
        return 1.6e9


def emulator(**options):
    return Nmea2000Emulator(Boat(), np.random.default_rng(1), noise_deg=0.0, rate_noise_deg_s=0.0, **options)


def messages(device, seconds, begin_s=0.0):
    """Return PGN, source and data of the messages until a time."""
    data = b""
    while (now_s := device.next_output_s()) <= begin_s + seconds:
        data += device.take_output(now_s)
    found = []
    for frame in data.split(b"\x10\x03")[:-1]:
        body = frame[2:].replace(b"\x10\x10", b"\x10")
        assert frame[:2] == b"\x10\x02"
        assert sum(body) % 256 == 0
        found.append((int.from_bytes(body[3:6], "little"), body[7], body[13:-1]))
    return found


@pytest.mark.parametrize(
    ("data", "expected"),
    [  # samples of the database of canboat
        (n2k.heading(3.1410, n2k.MAGNETIC, sequence=0), "00b27aff7fff7ffd"),
        (n2k.heading(3.1230, n2k.TRUE, variation_rad=0.0374), "fffe79ff7f7601fc"),
        (n2k.attitude(-0.0097, 0.0081, 3.1321), "ff597a51009fffff"),
        (n2k.rudder(0.6219, 255), "ffffff7f4b18ffff"),
        (n2k.depth(0.54, 0.7), "ff36000000bc02ff"),
        (n2k.position(53.1801965, 5.4284681), "6da7b21f89513c03"),
        (n2k.course(1.5924, 0.01), "fffc343e0100ffff"),
        (n2k.system_time(19245 * 86400 + 43621.4), "fff02d4bf018001a"),
    ],
)
def test_documented_messages(data, expected):
    if expected.startswith("ffffff7f"):  # the order of the rudder is not available in ours
        assert data[4:].hex() == expected[8:]
    else:
        assert data.hex() == expected


def test_documented_frames():
    assert n2k.raw_line(127250, 0x13, bytes.fromhex("00163AFF7FFF7FFD"), t_s=1798.627) == (
        b"00:29:58.627 R 09F11213 00 16 3A FF 7F FF 7F FD\r\n"
    )
    assert bytes.fromhex("1002A10311020049") + b"\x10\x03" == START_COMMAND
    frames = list(n2k.frames(bytes(range(20)), 3))
    assert [frame.hex() for frame in frames] == ["6014000102030405", "61060708090a0b0c", "620d0e0f10111213"]


def test_gateway_forwards_only_a_part_until_it_is_started():
    device = emulator()
    assert {pgn for pgn, _, _ in messages(device, 1.0)} == {127488, 127489, 60928}
    device.receive(1.0, START_COMMAND[:4])
    device.receive(1.0, START_COMMAND[4:])
    headings = [row for row in messages(device, 1.0, 1.0) if row[0] == 127250]
    assert len(headings) in (9, 10)
    assert headings[0] == (127250, COMPASS, bytes.fromhex("ff2d44ff7fff7ffd"))  # 1.7453 rad, magnetic
    device.power_cycle(2.0, off_s=0.5)
    device.receive(2.2, START_COMMAND)  # without power
    assert {pgn for pgn, _, _ in messages(device, 1.0, 2.0)} == {127488, 127489}
    assert device.bus_commands == 0


def test_messages_for_the_bus_are_counted():
    device = emulator()
    device.receive(1.0, n2k.actisense_frame(n2k.BUS_COMMAND, b"\x02\x12\xf1\x01\xff\x08" + bytes(8)))
    assert device.bus_commands == 1


def test_devices_of_the_bus():
    device = emulator(declination_deg=10.0)
    device.add_second_compass(Boat(200.0))
    device.add_receiver(Boat())
    device.receive(0.0, START_COMMAND)
    received = messages(device, 10.6)
    rates = {key: sum(1 for pgn, source, _ in received if (pgn, source) == key) for key in (
        (127250, COMPASS), (127250, SECOND_COMPASS), (127251, COMPASS), (127257, COMPASS), (129029, 0x10),
        (129026, 0x10), (60928, COMPASS))}  # fmt: skip
    assert list(rates.values()) == pytest.approx([106, 106, 106, 11, 11, 42, 2], abs=1)
    headings = {source: int.from_bytes(data[1:3], "little") for pgn, source, data in received if pgn == 127250}
    assert headings == {COMPASS: round(math.radians(90.0) * 1e4), SECOND_COMPASS: round(math.radians(190.0) * 1e4)}
    device.addresses[COMPASS] = 0x77
    assert (127250, 0x77) in {row[:2] for row in messages(device, 1.0, 10.6)}


def test_invalid_rate():
    with pytest.raises(ValueError, match="must be positive"):
        emulator(rate_hz=0.0)
