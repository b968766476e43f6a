"""Framing of binary protocols: packets, skipped bytes, and computing time of crafted noise."""

import pytest

from firmware_py.sensors import pni_protocol, ubx_protocol
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer
from firmware_py.sensors.pni_protocol import Frame

GET_MODULE_INFO = bytes.fromhex("000501efd4")
GET_DATA = bytes.fromhex("000504bf71")
DAMAGED = GET_MODULE_INFO[:-1] + b"\x00"
NESTED = pni_protocol.encode(Frame.DATA, GET_MODULE_INFO)  # a packet that contains a packet


@pytest.mark.parametrize(
    ("chunks", "packets"),
    [
        ([], []),
        ([GET_MODULE_INFO + GET_DATA], [(0, 5, GET_MODULE_INFO), (5, 5, GET_DATA)]),
        ([b"hello" + GET_MODULE_INFO + b"\xff"], [(0, 5, "malformed"), (5, 5, GET_MODULE_INFO), (10, 1, "malformed")]),
        ([DAMAGED + GET_DATA + DAMAGED], [(0, 5, "checksum"), (5, 5, GET_DATA), (10, 5, "checksum")]),
        ([GET_MODULE_INFO, GET_DATA[:4]], [(0, 5, GET_MODULE_INFO), (5, 4, "checksum")]),
        ([b"hello" + GET_MODULE_INFO[:4], GET_MODULE_INFO[4:]], [(0, 5, "malformed"), (5, 5, GET_MODULE_INFO)]),
        ([NESTED + GET_DATA], [(0, 10, NESTED), (10, 5, GET_DATA)]),
    ],
    ids=["empty", "packets", "noise", "damaged", "truncated", "in two parts", "nested"],
)
def test_stream_is_split_into_packets_and_skipped_bytes(chunks, packets):
    framer = pni_protocol.create_framer()
    found = [packet for chunk in chunks for packet in framer.feed(chunk)] + framer.finish()
    assert [(packet.offset, packet.size, packet.fault or packet.data) for packet in found] == packets


def test_false_length_does_not_delay_the_valid_packets_after_it():
    framer = pni_protocol.create_framer()
    assert framer.feed(b"\x00\x7f\x05") == []  # a header with a length of 127 bytes
    (skipped, info) = framer.feed(GET_MODULE_INFO)
    assert (skipped.size, skipped.fault, info.data) == (3, "checksum", GET_MODULE_INFO)
    assert [packet.data for packet in framer.feed(GET_DATA)] == [GET_DATA]


@pytest.mark.parametrize("size", [1, 64, 4096])
def test_noise_of_headers_is_searched_and_checked_once(size):
    """Every sixth byte starts a header with the maximum length; the time must not be quadratic."""
    headers, checked = [], []
    framer = PacketFramer(
        ubx_protocol._HEADER,
        6,
        lambda header: headers.append(header) or int.from_bytes(header[4:6], "little") + 8,
        PacketCheck(lambda packet: bool(checked.append(len(packet)))),
    )
    noise = b"\xb5\x62\x01\x07\xff\x09" * 2000
    for start in range(0, len(noise), size):
        assert framer.feed(noise[start : start + size]) == []
        assert len(framer._buffer) <= 0x9FF + 8
    assert len(headers) == 2000
    assert len(checked) <= 2000
