"""Comparison of the codec with pymavlink, and of the added messages with the published definitions."""

import re
import struct
import subprocess
import sys

import pytest

from firmware_py.link.signing import EPOCH_S, Signing
from firmware_py.link.wire import dialect
from firmware_py.link.wire.dialect import encode_text, mavlink
from firmware_py.link.wire.frames import Codec, stamp
from support.paths import DATA

DEFINITIONS = DATA / "mavlink" / "definitions"

AVAILABLE_MODES = mavlink.mavlink_map[435]
MESSAGES = {
    "numbers, the last of them 0": mavlink.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
    "a text, and a field named id": mavlink.MAVLink_statustext_message(4, b"Compass: no data", 3, 1),
    "arrays": mavlink.MAVLink_battery_status_message(0, 0, 1, 2510, [12345] + [0xFFFF] * 9, -120, 5, -1, 80),
    "nothing but 0": mavlink.MAVLink_system_time_message(0, 0),
    "one that pymavlink lacks": AVAILABLE_MODES(4, 2, 0, 15, 4, b"GUIDED"),
}


def make_sender(sequence=77):
    sender = mavlink.MAVLink(None, srcSystem=9, srcComponent=1)
    sender.seq = sequence
    return sender


@pytest.mark.parametrize("sequence", [0, 77, 255])
@pytest.mark.parametrize("kind", MESSAGES)
def test_stamped_frame_equals_that_of_pymavlink(kind, sequence):
    message = MESSAGES[kind]
    assert stamp(Codec(9, 1).pack(message), sequence) == message.pack(make_sender(sequence))


def test_installed_pymavlink_can_pack_the_payload_only():
    assert Codec(9, 1).packs_payload_only


def test_signed_frame_equals_that_of_pymavlink():
    signing = Signing(lambda: EPOCH_S + 1e6, lambda *_, **__: None)
    signing.set_key(bytes(range(32)), 0)
    for message in MESSAGES.values():
        sender = make_sender()
        frame = signing.seal(Codec(9, 1).pack(message), 77, 3)
        sender.signing.secret_key, sender.signing.link_id, sender.signing.sign_outgoing = bytes(range(32)), 3, True
        sender.signing.timestamp = int.from_bytes(frame[-12:-6], "little")
        assert frame == message.pack(sender)


PAYLOADS = {type(message): message.pack(mavlink.MAVLink(None))[10:-2] for message in MESSAGES.values()}


def pack_by_class_method(message, mav):
    """Pack with a function that is not looked up in the message."""
    return mavlink.MAVLink_message._pack(message, mav, message.crc_extra, PAYLOADS[type(message)])


def pack_with_another_payload(message, mav):
    """Call the method of the message, but pack a longer payload."""
    payload = PAYLOADS[type(message)]
    packed = message._pack(mav, message.crc_extra, payload)
    return mavlink.MAVLink_message._pack(message, mav, message.crc_extra, payload + b"\7") if mav else packed


@pytest.mark.parametrize("pack", [pack_by_class_method, pack_with_another_payload])
def test_pymavlink_with_another_packing_packs_complete_messages(monkeypatch, pack):
    added_numbers = {row.number for row in dialect.ADDITIONS}
    for message in MESSAGES.values():
        if type(message).id not in added_numbers:
            monkeypatch.setattr(type(message), "pack", pack)
    codec = Codec(9, 1)
    assert not codec.packs_payload_only
    for message in MESSAGES.values():
        assert stamp(codec.pack(message), 77) == message.pack(make_sender())


def test_pymavlink_without_the_private_method_packs_complete_messages(monkeypatch):
    expected = {}
    for kind, message in MESSAGES.items():
        expected[kind] = message.pack(make_sender(0))
        monkeypatch.setattr(type(message), "pack", lambda _message, _mav, frame=expected[kind]: frame)
    monkeypatch.delattr(mavlink.MAVLink_message, "_pack")
    codec = Codec(9, 1)
    assert not codec.packs_payload_only
    assert {kind: stamp(codec.pack(message), 0) for kind, message in MESSAGES.items()} == expected


@pytest.mark.parametrize("data", [bytes(90), bytes(range(1, 91)), b"\1" + bytes(89)])
def test_packed_payload_equals_that_of_pymavlink(data):
    payload = struct.pack("<IHB", 180, 3, 90) + data
    expected = mavlink.MAVLink_log_data_message(3, 180, 90, data).pack(make_sender(7))
    assert stamp(Codec(9, 1).pack_payload(mavlink.MAVLINK_MSG_ID_LOG_DATA, payload), 7) == expected


def test_payload_of_zeros_is_truncated_to_one_byte():
    expected = mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0).pack(make_sender(0))
    assert stamp(Codec(9, 1).pack_payload(mavlink.MAVLINK_MSG_ID_LOG_ENTRY, bytes(14)), 0) == expected


def test_decoded_message_has_the_packed_fields():
    codec = Codec(1, 1)
    packed = codec.pack(AVAILABLE_MODES(4, 2, 0, 15, 4, b"GUIDED"))
    message = codec.decode(stamp(packed, 0))
    assert (message.number_modes, message.mode_index, message.custom_mode) == (4, 2, 15)
    assert (message.properties, message.mode_name) == (4, b"GUIDED")


def test_added_messages_are_packed_and_decoded_as_those_of_pymavlink(monkeypatch):
    for row in dialect.ADDITIONS:
        kind = dialect._message_class(row)
        monkeypatch.setitem(mavlink.mavlink_map, row.number, kind)
        values = {
            name: b"x" * int(code[:-1]) if code.endswith("s") else number
            for number, (name, code) in enumerate(zip(row.wire, re.findall(r"\d*[a-zA-Z]", row.layout), strict=True), 1)
        }
        packed = kind(*(values[name] for name in row.fields)).pack(make_sender())
        decoded = mavlink.MAVLink(None).decode(bytearray(packed))
        assert type(decoded) is kind
        assert {name: getattr(decoded, name) for name in row.fields} == values
        assert (decoded.get_type(), decoded.get_fieldnames()) == (row.name, list(row.fields))


def test_damaged_frame_is_not_decoded():
    assert Codec(1, 1).decode(b"\xfd\x01\x00\x00\x00\x01\x01\x00\x00\x00\x00\x00\x00") is None


@pytest.mark.skipif(not DEFINITIONS.is_dir(), reason="the published definitions (../shared) are missing")
def test_added_messages_equal_the_published_definitions():
    mavparse = pytest.importorskip("pymavlink.generator.mavparse")
    published = {}
    for name in ("minimal.xml", "standard.xml", "common.xml"):
        parsed = mavparse.MAVXML(str(DEFINITIONS / name), mavparse.PROTOCOL_2_0)
        published.update({message.id: message for message in parsed.message})
    for row in dialect.ADDITIONS:
        if row.number not in published:
            ardupilotmega = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
            message = ardupilotmega.mavlink_map[row.number]
            assert (row.name, row.seed) == (message.msgname, message.crc_extra)
            assert (list(row.wire), list(row.fields)) == (message.ordered_fieldnames, message.fieldnames)
            assert mavlink.mavlink_map[row.number].unpacker.size == message.unpacker.size
            continue
        message = published[row.number]
        assert (row.name, row.seed) == (message.name, message.crc_extra)
        assert list(row.wire) == message.ordered_fieldnames
        assert list(row.fields) == [field.name for field in message.fields]
        assert mavlink.mavlink_map[row.number].unpacker.size == message.wire_length


def test_link_does_not_import_mavutil():
    script = "import sys, firmware_py.link.endpoint; sys.exit('pymavlink.mavutil' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_text_is_truncated_and_encoded_as_ascii():
    assert encode_text("Höhe" * 9, 5) == b"H?heH"
