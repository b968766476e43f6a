"""Xbus messages compared with the manual and with bytes computed by hand."""

import pytest

from firmware_py.sensors import mti_protocol as xbus
from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, MessageError
from firmware_py.sensors.mti_protocol import Message

EACH_MESSAGE = 0xFFFF

# Counter, time, status, rate of turn.
DATA = bytes.fromhex("FAFF3622 1020021234 1060040001E240 E0200400000003 80200C0000000000000000BE000000 29")


def long_form(message, data):
    body = bytes([0xFF, message, 0xFF]) + len(data).to_bytes(2, "big") + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def split(stream):
    framer = xbus.create_framer()
    return [*framer.feed(stream), *framer.finish()]


@pytest.mark.parametrize(
    ("message", "frame"),
    [
        (Message.GO_TO_CONFIG, "FAFF3000D1"),
        (Message.GO_TO_MEASUREMENT, "FAFF1000F1"),
        (Message.WAKE_UP_ACK, "FAFF3F00C2"),
        (Message.OUTPUT_CONFIGURATION, "FAFFC00041"),
    ],
)
def test_commands_are_those_of_the_manual(message, frame):
    assert xbus.encode(message) == bytes.fromhex(frame)


def test_command_longer_than_the_short_form_is_rejected():
    assert len(xbus.encode(Message.OUTPUT_CONFIGURATION, bytes(254))) == 259
    with pytest.raises(ValueError, match="254"):
        xbus.encode(Message.OUTPUT_CONFIGURATION, bytes(255))


def test_message_is_complete_with_its_last_byte():
    framer = xbus.create_framer()
    assert framer.feed(bytes.fromhex("FAFF3100")) == []
    (packet,) = framer.feed(b"\xd0")
    assert (xbus.message_id(packet.data), xbus.payload(packet.data)) == (Message.GO_TO_CONFIG_ACK, b"")


def test_long_form_has_at_most_2048_bytes():
    for size in (700, 2048):
        (packet,) = split(long_form(Message.MT_DATA2, bytes(size)))
        assert xbus.payload(packet.data) == bytes(size)
    assert split(long_form(Message.MT_DATA2, bytes(2049)))[0].fault == MALFORMED


def test_wrong_sum_is_a_checksum_error_and_the_next_message_is_decoded():
    damaged = bytearray(DATA)
    damaged[8] ^= 0x10
    bad, good = split(bytes(damaged) + DATA)
    assert (bad.fault, bad.size, good.data) == (CHECKSUM, len(DATA), DATA)


def test_messages_that_a_device_sends_are_known():
    known = {number for number in range(256) if not split(long_form(number, b"\x01"))[0].fault}
    assert known == {0x01, 0x0D, 0x11, 0x13, 0x31, 0x36, 0x3E, 0x42, 0x43, 0x91, 0xC1}


def test_commands_and_other_protocols_are_noise():
    (skipped,) = split(xbus.encode(Message.GO_TO_CONFIG) + b"$HEHDT,341.8,T*21\r\n")
    assert skipped.fault == MALFORMED


def test_items_of_a_data_message():
    (packet,) = split(DATA)
    items = xbus.parse_items(xbus.payload(packet.data))
    assert {identifier: value.hex() for identifier, value in items.items()} == {
        0x1020: "1234",
        0x1060: "0001e240",
        0xE020: "00000003",
        0x8020: "0000000000000000be000000",
    }
    assert xbus.parse_items(b"") == {}
    assert xbus.parse_items(b"\xe0\x20\x00") == {0xE020: b""}


@pytest.mark.parametrize("size", [1, 2, 4, 6, 20])
def test_truncated_items_are_malformed(size):
    with pytest.raises(MessageError, match="malformed"):
        xbus.parse_items(bytes.fromhex("E020040000000380200C000000000000000000000000")[:size])


def test_output_configuration_is_encoded_and_parsed():
    rows = {0xE020: EACH_MESSAGE, 0x2034: 10}
    data = xbus.encode_output_configuration(rows.items())
    assert data == bytes.fromhex("E020FFFF2034000A")
    assert xbus.parse_output_configuration(data) == rows
    with pytest.raises(MessageError):
        xbus.parse_output_configuration(data[:-1])


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\x21", "device error 33: parameter invalid"),
        (b"\x63", "device error 99"),
        (b"", "device error without a code"),
        (b"\x29\x00", "device error 41: more data than the baud rate allows"),
    ],
)
def test_text_of_device_errors(data, text):
    assert xbus.error_text(data) == text


def test_known_device_errors():
    known = {code for code in range(256) if ":" in xbus.error_text(bytes([code]))}
    assert known == {3, 4, 30, 32, 33, 35, 36, 40, 41, 42}
