"""Codec of the Dynamixel protocol, compared with the SDK of the manufacturer."""

import pytest
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from dynamixel_sdk.robotis_def import COMM_SUCCESS
from hypothesis import assume, example, given
from hypothesis import strategies as st

from firmware_py.actuator import dynamixel_frames as frames

PATTERN = frames.UNSTUFFED_PATTERN  # stuffing adds a byte after it
SDK = Protocol2PacketHandler()
IDS = st.integers(0, 252)
# Payloads in which the pattern that needs stuffing, and the stuffed pattern, occur often.
PAYLOADS = st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00", PATTERN, b"\x55\x01\x80"]) | st.binary(max_size=3)).map(
    b"".join
)


class FakePort:
    """A port for dynamixel_sdk: collects written bytes, and returns the reply."""

    def __init__(self, reply=b""):
        self.is_using = False
        self.reply = list(reply)
        self.written = b""

    def clearPort(self):  # noqa: N802 - name of the SDK
        pass

    def writePort(self, packet):  # noqa: N802
        self.written = bytes(packet)
        return len(packet)

    def readPort(self, count):  # noqa: N802
        taken, self.reply = self.reply[:count], self.reply[count:]
        return taken

    def setPacketTimeout(self, count):  # noqa: N802
        pass

    def isPacketTimeout(self):  # noqa: N802
        return not self.reply


def sdk_frame(device_id, instruction, parameters):
    """Return a frame by the stuffing and CRC of the SDK.

    txPacket of the SDK (4.1.0) loses the stuffing, because addStuffing rebinds its argument and returns the result.
    """
    length = len(parameters) + 3
    packet = [*frames.HEADER, device_id, length & 0xFF, length >> 8, instruction, *parameters, 0, 0]
    stuffed = SDK.addStuffing(packet)
    crc = SDK.updateCRC(0, stuffed, len(stuffed) - 2)
    stuffed[-2:] = [crc & 0xFF, crc >> 8]
    return bytes(stuffed)


def test_ping_of_the_protocol_page():
    assert frames.ping(1) == bytes.fromhex("FFFFFD00 01 0300 01 194E")


def test_sync_write_of_the_protocol_page():
    two_servos = bytes.fromhex("7400 0400 01 96000000 02 AA000000")
    frame = frames.instruction(frames.BROADCAST_ID, frames.SYNC_WRITE, two_servos)
    assert frame == bytes.fromhex("FFFFFD00 FE 1100 83") + two_servos + bytes.fromhex("8287")


@given(IDS, st.integers(0, 661), st.binary(min_size=1, max_size=200))
def test_sync_writes_are_those_of_the_sdk(device_id, address, data):
    body = address.to_bytes(2, "little") + len(data).to_bytes(2, "little") + bytes((device_id,)) + data
    assume(PATTERN not in body)  # see sdk_frame
    port = FakePort()
    assert SDK.syncWriteTxOnly(port, address, len(data), [device_id, *data], 1 + len(data)) == COMM_SUCCESS
    assert frames.sync_write(device_id, address, data) == port.written


@given(IDS, st.integers(0, 65535), st.integers(0, 65535))
def test_read_ping_and_reboot_are_those_of_the_sdk(device_id, address, length):
    port = FakePort()
    assume(PATTERN not in bytes((address & 255, address >> 8, length & 255, length >> 8)))  # see sdk_frame
    assert SDK.readTx(port, device_id, address, length) == COMM_SUCCESS
    assert frames.read(device_id, address, length) == port.written
    port = FakePort()
    SDK.ping(port, device_id)
    assert frames.ping(device_id) == port.written
    port = FakePort()
    SDK.reboot(port, device_id)
    assert frames.reboot(device_id) == port.written


@given(IDS, st.integers(0, 661), st.binary(min_size=1, max_size=200))
def test_writes_are_those_of_the_sdk(device_id, address, data):
    body = address.to_bytes(2, "little") + data
    assume(PATTERN not in body)  # see sdk_frame
    port = FakePort()
    assert SDK.writeTxOnly(port, device_id, address, len(data), list(data)) == COMM_SUCCESS
    assert frames.write(device_id, address, data) == port.written


@given(IDS, PAYLOADS)
@example(1, PATTERN)
@example(1, PATTERN + PATTERN + b"\xfd\xfd" + PATTERN)
@example(1, b"\xff\xff")
def test_stuffing_is_that_of_the_sdk(device_id, data):
    assert frames.write(device_id, 0x74, data) == sdk_frame(device_id, frames.WRITE, b"\x74\x00" + data)


@given(IDS, st.integers(0, 255), PAYLOADS)
def test_parser_decodes_status_packets_of_the_sdk(device_id, error, data):
    packet = sdk_frame(device_id, frames.STATUS, bytes((error,)) + data)
    parser = frames.StatusParser()
    assert parser.feed(packet) == [frames.StatusPacket(device_id, error, data)]
    assert parser.pending == parser.rejected == 0


@given(IDS, st.integers(0, 255), PAYLOADS)
def test_sdk_decodes_the_status_packets_of_these_tests(fakes, device_id, error, data):
    # removeStuffing of the SDK reads bytes that it has already moved: it is correct for only one stuffing.
    assume(b"\xfd" not in (bytes((error,)) + data).partition(PATTERN)[2])
    packet = fakes.status_frame(device_id, error, data)
    read, result, read_error = SDK.readRx(FakePort(packet), device_id, len(data))
    assert (bytes(read), result, read_error) == (data, COMM_SUCCESS, error)
    assert frames.StatusParser().feed(packet) == [frames.StatusPacket(device_id, error, data)]


def test_echo_of_instructions_is_skipped(fakes):
    parser = frames.StatusParser()
    echo = frames.read(1, 126, 21) + frames.write(1, 116, b"\xff\xff\xfd\x00") + frames.ping(1)
    assert parser.feed(echo + fakes.status_frame(1, 0)) == [frames.StatusPacket(1, 0, b"")]
    assert parser.rejected == 0


@pytest.mark.parametrize("noise", [b"", b"\x00\xff\xff"])
def test_truncated_packet_is_counted_and_the_next_one_decoded(fakes, noise):
    packet = fakes.status_frame(1, 0, bytes(30))
    for cut in range(len(packet)):
        parser = frames.StatusParser()
        stream = noise + packet[:cut] + fakes.status_frame(1, 0, b"\x07")
        assert parser.feed(stream) == [frames.StatusPacket(1, 0, b"\x07")], cut
        assert parser.rejected == (cut > 7), cut  # from the instruction byte on, which marks a status packet
        assert parser.pending == 0


def test_damaged_packet_is_counted_and_the_next_one_decoded(fakes):
    packet = fakes.status_frame(1, 0, bytes(range(30)))
    for position in range(8, len(packet)):
        damaged = bytearray(packet)
        damaged[position] ^= 0x40
        parser = frames.StatusParser()
        assert parser.feed(bytes(damaged) + packet) == [frames.StatusPacket(1, 0, bytes(range(30)))], position
        assert parser.rejected == 1, position


def test_crc_may_contain_the_start_of_a_header(fakes):
    data = bytes.fromhex("bfff00ffff")
    packet = fakes.status_frame(1, 0, data)
    assert packet.endswith(frames.HEADER)
    parser = frames.StatusParser()
    assert parser.feed(packet) == [frames.StatusPacket(1, 0, data)]


def test_packet_with_a_damaged_length_is_skipped(fakes):
    damaged = bytearray(fakes.status_frame(1, 0, b"abc"))
    damaged[5:7] = (5000).to_bytes(2, "little")
    parser = frames.StatusParser()
    assert parser.feed(bytes(damaged)) == []
    assert parser.pending <= 3
    assert parser.rejected == 1


@pytest.mark.parametrize("size", [0, 30, 252, 300])
def test_longest_packet_is_decoded_and_a_longer_one_rejected(fakes, size):
    packet = fakes.status_frame(1, 0, bytes(size))
    assert frames.StatusParser(size + 4).feed(packet) == [frames.StatusPacket(1, 0, bytes(size))]
    parser = frames.StatusParser(size + 3)
    assert parser.feed(packet) == []
    assert parser.rejected == 1


def test_alert_and_code_of_the_error_byte():
    packet = frames.StatusPacket(1, 0x84, b"")
    assert packet.alert
    assert packet.code == 4
    assert not frames.StatusPacket(1, 4, b"").alert


@pytest.mark.parametrize("size", range(4, 10))
def test_clear_discards_an_incomplete_packet(fakes, size):
    packet = fakes.status_frame(1, 0, b"abc")
    parser = frames.StatusParser()
    parser.feed(packet[:size])
    assert parser.pending == size
    parser.clear()
    assert parser.feed(packet[size:]) == []
