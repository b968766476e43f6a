import fastcrc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.devices.crc import crc16_1021, crc16_8005


@pytest.mark.parametrize(
    "frame",
    ["000501EFD4", "000504BF71", "00090A000000145CF9", "000A0304051819 08DACC", "000515BD61",
     "000F180000000000003DCCCCCDF971", "000D0254434D3531323038C787"],
)  # fmt: skip
def test_frames_printed_in_pni_manuals(frame):
    raw = bytes.fromhex(frame)
    assert crc16_1021(raw[:-2]) == int.from_bytes(raw[-2:], "big")


@pytest.mark.parametrize(
    "frame",
    # All from the e-manual's Protocol 2.0 page.
    ["FFFFFD000103000119 4E", "FFFFFD000107005500060426655D", "FFFFFD00010700028400 04001D15",
     "FFFFFD0001090003740000020000CA89", "FFFFFD00FE09008284000400 0102CEFA"],
)  # fmt: skip
def test_packets_printed_in_the_dynamixel_manual(frame):
    raw = bytes.fromhex(frame)
    assert crc16_8005(raw[:-2]) == int.from_bytes(raw[-2:], "little")


@pytest.mark.parametrize("frame", ["DC0108008014", "DC010F809114", "B0010000C006"])
def test_volz_frames(frame):
    raw = bytes.fromhex(frame)
    assert crc16_8005(raw[:-2], 0xFFFF) == int.from_bytes(raw[-2:], "big")


@given(st.binary(max_size=80))
def test_equals_a_library(data):
    assert crc16_1021(data) == fastcrc.crc16.xmodem(data)
    assert crc16_8005(data) == fastcrc.crc16.umts(data)
    assert crc16_8005(data, 0xFFFF) == fastcrc.crc16.cms(data)
