"""Parsing of datagrams that pymavlink has packed."""

from pymavlink.dialects.v20 import common as mavlink

from hil.bench.transfers import parse_datagram


def test_all_frames_of_a_datagram_are_parsed():
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    data = mavlink.MAVLink_param_value_message(b"CTL_K1", 40.0, 9, 33, 7).pack(sender)
    sender.signing.secret_key, sender.signing.sign_outgoing = bytes(range(32)), True
    data += mavlink.MAVLink_mission_request_int_message(255, 190, 499, 0).pack(sender)
    data += mavlink.MAVLink_log_data_message(1, 900, 90, list(range(90))).pack(sender)
    value, request, part = parse_datagram(data)
    assert (value.number, int.from_bytes(value.payload[4:6], "little"), value.payload[6]) == (22, 33, 7)
    assert (request.number, int.from_bytes(request.payload[:2], "little")) == (51, 499)
    assert (part.number, int.from_bytes(part.payload[:4], "little"), part.payload[6]) == (120, 900, 90)
    assert bytes(part.payload[7:97]) == bytes(range(90))


def test_parsing_ends_at_other_bytes():
    assert list(parse_datagram(b"")) == list(parse_datagram(b"\xfe" * 30)) == []
    (message,) = parse_datagram(b"\xfd\x01\0\0\0\1\1\0\0\0\1\0\0" + b"other bytes")
    assert message.number == 0
