import fastcrc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.devices.crc import crc16_1021, crc16_8005


@pytest.mark.parametrize(
    ("crc", "order", "initial", "frames"),
    [
        (crc16_1021, "big", 0, "000501EFD4 000504BF71 00090A000000145CF9 000A030405181908DACC 000515BD61"),
        (crc16_1021, "big", 0, "000F180000000000003DCCCCCDF971 000D0254434D3531323038C787"),
        (crc16_8005, "little", 0, "FFFFFD0001030001194E FFFFFD000107005500060426655D"),
        (crc16_8005, "little", 0, "FFFFFD0001070002840004001D15 FFFFFD0001090003740000020000CA89"),
        (crc16_8005, "little", 0, "FFFFFD00FE090082840004000102CEFA"),
        (crc16_8005, "big", 0xFFFF, "DC0108008014 DC010F809114 B0010000C006"),
    ],
    ids=["pni", "pni-long", "dynamixel", "dynamixel-2", "dynamixel-3", "volz"],
)
def test_crc_equals_that_of_the_frames_in_the_manuals(crc, order, initial, frames):
    for raw in map(bytes.fromhex, frames.split()):
        assert crc(raw[:-2], initial) == int.from_bytes(raw[-2:], order), raw.hex()


@given(st.binary(max_size=80))
def test_crc_equals_that_of_a_library(data):
    assert crc16_1021(data) == fastcrc.crc16.xmodem(data)
    assert crc16_8005(data) == fastcrc.crc16.umts(data)
    assert crc16_8005(data, 0xFFFF) == fastcrc.crc16.cms(data)
