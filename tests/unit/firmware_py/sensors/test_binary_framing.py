"""Packets out of noise, and runs of noise accounted for."""

import random

import pytest

from firmware_py.sensors import pni_protocol, ubx_protocol
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer

INFO = bytes.fromhex("000501efd4")
DATA = bytes.fromhex("000504bf71")


def feed(framer, *chunks, end=True):
    packets = [packet for chunk in chunks for packet in framer.feed(chunk)]
    packets += framer.finish() if end else []
    return [(packet.offset, packet.size, packet.fault or packet.data) for packet in packets]


def test_packets_in_a_row():
    assert feed(pni_protocol.framer(), INFO + DATA) == [(0, 5, INFO), (5, 5, DATA)]


def test_noise_is_one_run_and_a_damaged_packet_is_called_so():
    assert feed(pni_protocol.framer(), b"hello" + INFO + b"\xff") == [
        (0, 5, "malformed"), (5, 5, INFO), (10, 1, "malformed")
    ]  # fmt: skip
    damaged = INFO[:-1] + b"\x00"
    assert feed(pni_protocol.framer(), damaged + DATA + damaged) == [
        (0, 5, "checksum"), (5, 5, DATA), (10, 5, "checksum")
    ]  # fmt: skip


def test_a_false_length_does_not_hold_back_the_good_packets_behind_it():
    framer = pni_protocol.framer()
    false_start = b"\x00\x7f\x05"  # 127 bytes to come
    assert feed(framer, false_start, INFO, DATA, end=False) == [(0, 3, "checksum"), (3, 5, INFO), (8, 5, DATA)]


@pytest.mark.parametrize("piece", [1, 2, 3, 7])
def test_a_packet_may_come_in_pieces(piece, solution):
    stream = b"$GPGGA*00\r\n" + solution() + b"\xb5\x62" + solution()
    whole = feed(ubx_protocol.framer(), stream)
    pieces = [stream[start : start + piece] for start in range(0, len(stream), piece)]
    assert feed(ubx_protocol.framer(), *pieces) == whole
    assert [fault for *_, fault in whole if isinstance(fault, str)] == ["malformed", "checksum"]


def test_a_capture_that_ends_within_a_packet_is_reported():
    assert feed(pni_protocol.framer(), INFO, DATA[:4]) == [(0, 5, INFO), (5, 4, "checksum")]
    assert feed(pni_protocol.framer()) == []


@pytest.mark.parametrize("piece", [1, 64, 4096])
def test_crafted_noise_is_searched_and_checked_once_however_it_is_cut(piece):
    """Every sixth byte claims to begin the longest packet: it may cost its bytes, and not its square."""
    measured, checked = [], []
    framer = PacketFramer(
        ubx_protocol._HEADER,
        6,
        lambda header: measured.append(header) or int.from_bytes(header[4:6], "little") + 8,
        PacketCheck(lambda packet: bool(checked.append(len(packet)))),
    )
    noise = b"\xb5\x62\x01\x07\xff\x09" * 2000
    for start in range(0, len(noise), piece):
        assert framer.feed(noise[start : start + piece]) == []
        assert len(framer._buffer) <= 0x9FF + 8
    assert len(measured) == 2000
    assert len(checked) <= 2000


def test_sums_carried_along_are_the_checksum():
    """Against the checksum as the receiver's manual gives it, byte by byte."""
    chances = random.Random(3)
    framer = ubx_protocol.framer()
    for _ in range(300):
        body = chances.randbytes(2) + (size := chances.randrange(200)).to_bytes(2, "little") + chances.randbytes(size)
        first = second = 0
        for byte in body:
            first = (first + byte) & 0xFF
            second = (second + first) & 0xFF
        whole = b"\xb5\x62" + body + bytes((first, second))
        broken = b"\xb5\x62" + body + bytes((first, second ^ 1))
        noise = chances.randbytes(chances.randrange(20))
        found = [packet.data for piece in (noise, broken, whole) for packet in framer.feed(piece) if not packet.fault]
        assert whole in found
        assert broken not in found
