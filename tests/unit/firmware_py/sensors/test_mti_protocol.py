"""Xbus messages as the manual has them, bytes and sums worked out by hand."""

import struct

import pytest

from firmware_py.sensors import mti_protocol as xbus
from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, MessageError
from firmware_py.sensors.mti_protocol import EACH_MESSAGE, Message

# Counter, time, status, rate of turn.
DATA = bytes.fromhex("FAFF3622 1020021234 1060040001E240 E0200400000003 80200C0000000000000000BE000000 29")


def long_form(message, data):
    body = bytes([0xFF, message, 0xFF]) + len(data).to_bytes(2, "big") + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def cut(stream):
    framer = xbus.framer()
    return [*framer.feed(stream), *framer.finish()]


@pytest.mark.parametrize(
    ("message", "wire"),
    [
        (Message.GO_TO_CONFIG, "FAFF3000D1"),
        (Message.GO_TO_MEASUREMENT, "FAFF1000F1"),
        (Message.WAKE_UP_ACK, "FAFF3F00C2"),
        (Message.OUTPUT_CONFIGURATION, "FAFFC00041"),
    ],
)
def test_commands_are_those_of_the_manual(message, wire):
    assert xbus.encode(message) == bytes.fromhex(wire)


def test_a_command_of_more_than_the_short_form_is_refused():
    assert len(xbus.encode(0xC0, bytes(254))) == 259
    with pytest.raises(ValueError, match="254"):
        xbus.encode(0xC0, bytes(255))


def test_a_short_answer_is_seen_with_its_last_byte():
    framer = xbus.framer()
    assert framer.feed(bytes.fromhex("FAFF3100")) == []
    (packet,) = framer.feed(b"\xd0")
    assert (xbus.message_id(packet.data), xbus.payload(packet.data)) == (Message.GO_TO_CONFIG_ACK, b"")


def test_the_long_form_of_the_length_is_read_however_it_is_cut():
    message = long_form(Message.MT_DATA2, bytes(700))
    framer = xbus.framer()
    (packet,) = [found for place in range(len(message)) for found in framer.feed(message[place : place + 1])]
    assert xbus.payload(packet.data) == bytes(700)
    assert cut(long_form(Message.MT_DATA2, bytes(2048)))[0].fault == ""
    assert cut(long_form(Message.MT_DATA2, bytes(2049)))[0].fault == MALFORMED


def test_a_wrong_sum_is_a_checksum_error_and_the_next_message_is_found():
    damaged = bytearray(DATA)
    damaged[8] ^= 0x10
    bad, good = cut(bytes(damaged) + DATA)
    assert (bad.fault, bad.size, good.data) == (CHECKSUM, len(DATA), DATA)


def test_what_no_device_says_is_noise():
    (run,) = cut(xbus.encode(Message.GO_TO_CONFIG) + b"$HEHDT,341.8,T*21\r\n")
    assert run.fault == MALFORMED


def test_items_are_taken_apart():
    (packet,) = cut(DATA)
    items = xbus.parse_items(xbus.payload(packet.data))
    assert {identifier: value.hex() for identifier, value in items.items()} == {
        0x1020: "1234",
        0x1060: "0001e240",
        0xE020: "00000003",
        0x8020: "0000000000000000be000000",
    }
    assert xbus.parse_items(b"") == {}


@pytest.mark.parametrize("size", [1, 2, 4, 6, 20])
def test_items_that_end_early_are_malformed(size):
    with pytest.raises(MessageError, match="malformed"):
        xbus.parse_items(bytes.fromhex("E020040000000380200C000000000000000000000000")[:size])


def test_an_output_configuration_goes_there_and_back():
    rows = {0xE020: EACH_MESSAGE, 0x2034: 10}
    wire = xbus.output_configuration(rows.items())
    assert wire == bytes.fromhex("E020FFFF2034000A")
    assert xbus.parse_output_configuration(wire) == rows
    with pytest.raises(MessageError):
        xbus.parse_output_configuration(wire[:-1])


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\x21", "device error 33: parameter invalid"),
        (struct.pack(">B", 99), "device error 99"),
        (b"", "device error without a code"),
        (b"\x29\x00", "device error 41: more data than the baud rate carries"),
    ],
)
def test_errors_are_reported_with_their_meaning(data, text):
    assert xbus.error_text(data) == text
