"""Frames of a flight controller, compared with pymavlink and with recorded bytes."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.sensors.mavlink_frames import Encoder, Message, Stream, create_framer, decode_frame
from firmware_py.sensors.message_error import CHECKSUM

# ArduPilot's page "MAVLink Basics" and many tutorials: a quadrotor (2) of ArduPilot (3).
HEARTBEAT = bytes.fromhex("FE094E010100000000000203510403 1C7F".replace(" ", ""))
# Recorded from an Intel Aero with PX4 (mavlink/mavlink, issue 771): the end of a frame, TIMESYNC,
# ACTUATOR_CONTROL_TARGET, ATTITUDE, ATTITUDE_QUATERNION, ATTITUDE.
RECORDED = bytes(number & 0xFF for number in (
    -2, -55, 118, 66, 0, 0, 0, -128, 30, 1, -91, 117, -3, 14, 0, 0, 37, 1, 1, 111, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    -48, 24, -91, 112, -84, 4, 106, -33, -3, 40, 0, 0, 38, 1, 1, -116, 0, 0, 120, -32, 73, 50, 1, 0, 0, 0, -28, 29,
    -100, 59, -92, -22, 46, -68, -91, -120, -42, 62, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -128,
    -65, 7, -112, -3, 28, 0, 0, 39, 1, 1, 30, 0, 0, 2, 105, 78, 0, 88, -8, -120, -69, -4, -74, 45, 60, 61, 68, -93,
    -65, 10, 28, -24, -70, 79, -85, -69, -69, 46, 69, -2, 57, -17, -114, -3, 32, 0, 0, 40, 1, 1, 31, 0, 0, 29, 105,
    78, 0, -16, -84, 77, 63, 79, -106, -65, 58, 38, -4, -77, 59, 48, 107, 24, -65, 40, -61, -90, -70, 36, 46, 88,
    -69, -61, -83, 59, -69, 60, -63, -3, 28, 0, 0, 41, 1, 1, 30, 0, 0, 41, 105, 78, 0, -17, -91, -119, -69, 82,
    -109, 44, 60, 5, 69, -93, -65, 123, 62, -93, -70, -90, -95, 106, -69, 60, 20, 91, -71, 11, 118,
))  # fmt: skip

ATTITUDE_CRC_EXTRA = dialect.MAVLink_attitude_message.crc_extra
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER2
# One message of each kind, with different values in all fields.
MESSAGES = {
    Message.HEARTBEAT: dialect.MAVLink_heartbeat_message(11, 3, 81, 123456, 4, 3),
    Message.SYS_STATUS: dialect.MAVLink_sys_status_message(1, 2, 3, 400, 12345, -678, 91, 5, 6, 7, 8, 9, 10),
    Message.SYSTEM_TIME: dialect.MAVLink_system_time_message(1_767_225_600_123_456, 98765),
    Message.GPS_RAW_INT: dialect.MAVLink_gps_raw_int_message(
        123456789, 3, 361234567, -1211234567, 12345, 85, 130, 47, 35999, 14, 17000, 1200, 2300, 90, 5, 18000
    ),
    Message.ATTITUDE: dialect.MAVLink_attitude_message(98765, 0.1, -0.2, 3.0, 0.01, -0.02, 0.03),
    Message.GLOBAL_POSITION_INT: dialect.MAVLink_global_position_int_message(
        98765, 361234567, -1211234567, 12345, 10, -31, 42, 5, 35999
    ),
    Message.COMMAND_ACK: dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 3, 7, -8, 1, 191),
    Message.BATTERY_STATUS: dialect.MAVLink_battery_status_message(
        1, 2, 3, 2150, [4100 + cell for cell in range(10)], -120, 55, 66, 77, 88, 1, (11, 12, 13, 14), 2, 99
    ),
    Message.EKF_STATUS_REPORT: dialect.MAVLink_ekf_status_report_message(831, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    Message.ESTIMATOR_STATUS: dialect.MAVLink_estimator_status_message(
        123456, 831, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8
    ),
}


# Payload bytes of MAVLink 1, which has no extension fields; pymavlink would send them.
BASE_BYTES = {
    Message.SYS_STATUS: 31, Message.GPS_RAW_INT: 30, Message.COMMAND_ACK: 3, Message.BATTERY_STATUS: 36,
    Message.EKF_STATUS_REPORT: 22,
}  # fmt: skip


def pack(message, *, mavlink1=False, key=None):
    mav = dialect.MAVLink(None, srcSystem=7, srcComponent=9)
    if key is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    frame = bytes(message.pack(mav, force_mavlink1=mavlink1))
    if not mavlink1:
        return frame
    size = BASE_BYTES.get(frame[5], frame[1])
    covered = bytes((size,)) + frame[2 : 6 + size]
    return b"\xfe" + covered + dialect.x25crc(covered + bytes((message.crc_extra,))).crc.to_bytes(2, "little")


def frames(stream):
    """Return the decoded frames of a stream."""
    framer = create_framer()
    return [decode_frame(packet.data) for packet in framer.feed(stream) if not packet.fault]


def flat_values(message, names):
    for name in names:
        value = getattr(message, name)
        yield from value if isinstance(value, list | tuple) else (value,)


def single(value):
    return struct.unpack("<f", struct.pack("<f", value))[0] if isinstance(value, float) else value


@pytest.mark.parametrize("mavlink1", [False, True])
@pytest.mark.parametrize("number", MESSAGES, ids=lambda number: number.name)
def test_each_message_is_decoded_as_by_pymavlink(number, mavlink1):
    message = MESSAGES[number]
    (frame,) = frames(pack(message, mavlink1=mavlink1))
    assert (frame.message, frame.system, frame.component) == (number, 7, 9)
    decoded = dialect.MAVLink(None).decode(bytearray(pack(message, mavlink1=mavlink1)))
    assert len(frame.fields) == sum(max(1, length) for length in decoded.array_lengths)
    expected = [single(value) for value in flat_values(decoded, decoded.ordered_fieldnames)]
    assert list(frame.fields) == expected


def test_all_messages_are_tested():
    assert set(MESSAGES) == set(Message)


def test_documented_heartbeat():
    (frame,) = frames(HEARTBEAT)
    assert frame == (Message.HEARTBEAT, 1, 1, (0, 2, 3, 0x51, 4, 3))


def test_recorded_attitudes_among_other_messages():
    first, second = frames(RECORDED)
    assert (first.message, second.message) == (Message.ATTITUDE, Message.ATTITUDE)
    assert (first.fields[0], second.fields[0]) == (0x4E6902, 0x4E6929)
    assert first.fields[1:4] == pytest.approx((-0.00418, 0.01060, -1.27552), abs=1e-5)


def test_truncated_zeros_and_missing_extensions_are_zero():
    message = dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    stream = pack(message)
    assert stream[1] == 1
    assert frames(stream)[0].fields == (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert frames(pack(MESSAGES[Message.GPS_RAW_INT], mavlink1=True))[0].fields[10:] == (0,) * 6


def test_extension_fields_of_newer_definitions_are_ignored():
    payload = struct.pack("<I6f", 98765, 0.1, -0.2, 3.0, 0.01, -0.02, 0.03) + b"newer"
    header = bytes((len(payload), 0, 0, 5, 7, 9)) + Message.ATTITUDE.to_bytes(3, "little")
    checksum = dialect.x25crc(header + payload + bytes((ATTITUDE_CRC_EXTRA,))).crc
    (frame,) = frames(b"\xfd" + header + payload + checksum.to_bytes(2, "little"))
    assert frame.fields[0] == 98765


def test_signed_frame_is_read_with_its_signature():
    stream = pack(MESSAGES[Message.ATTITUDE], key=bytes(32))
    assert stream[2] == 1
    packets = create_framer().feed(stream + HEARTBEAT)
    assert [(packet.fault, packet.size) for packet in packets] == [("", 12 + 28 + 13), ("", 17)]
    assert [decode_frame(packet.data).message for packet in packets] == [Message.ATTITUDE, Message.HEARTBEAT]


def test_odd_sequence_number_of_mavlink_1_is_no_signature():
    covered = HEARTBEAT[1:2] + b"\x4f" + HEARTBEAT[3:-2]
    odd = b"\xfe" + covered + dialect.x25crc(covered + bytes((50,))).crc.to_bytes(2, "little")
    packets = create_framer().feed(odd + HEARTBEAT)
    assert [(packet.fault, packet.size) for packet in packets] == [("", 17), ("", 17)]


@pytest.mark.parametrize("position", [2, 5])
def test_frame_with_an_unknown_flag_or_without_a_system_is_not_read(position):
    stream = bytearray(pack(MESSAGES[Message.ATTITUDE]))
    stream[position] = 2 if position == 2 else 0
    stream[-2:] = dialect.x25crc(stream[1:-2] + bytes((ATTITUDE_CRC_EXTRA,))).crc.to_bytes(2, "little")
    assert frames(bytes(stream)) == []


def test_wrong_checksum_is_reported():
    damaged = bytearray(HEARTBEAT)
    damaged[8] ^= 1
    packets = create_framer().feed(bytes(damaged) + HEARTBEAT)
    assert [packet.fault for packet in packets] == [CHECKSUM, ""]


def decode_sent(data):
    """Decode bytes with pymavlink, which checks the checksum."""
    return dialect.MAVLink(None).decode(bytearray(data))


def test_own_messages_are_decoded_by_pymavlink():
    encoder = Encoder(COMPONENT)
    sent = (
        encoder.heartbeat(7),
        encoder.message_interval(7, 1, Message.ATTITUDE, 10),
        encoder.message_interval(7, 1, Message.SYSTEM_TIME, 3),
        encoder.data_stream(7, 1, Stream.EXTRA1, 0.2),
    )
    heartbeat, attitude, time, group = map(decode_sent, sent)
    assert {(data[0], data[2], data[3]) for data in sent} == {(0xFD, 0, 0)}  # without flags
    assert [message.get_seq() for message in (heartbeat, attitude, time, group)] == [0, 1, 2, 3]
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in (heartbeat, group)} == {(7, COMPONENT)}
    assert heartbeat.to_dict() == {
        "mavpackettype": "HEARTBEAT", "type": dialect.MAV_TYPE_ONBOARD_CONTROLLER,
        "autopilot": dialect.MAV_AUTOPILOT_INVALID, "base_mode": 0, "custom_mode": 0,
        "system_status": dialect.MAV_STATE_ACTIVE,
        "mavlink_version": 3,
    }  # fmt: skip
    assert (attitude.get_type(), attitude.command, attitude.target_system, attitude.target_component) == (
        "COMMAND_LONG", dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 7, 1,
    )  # fmt: skip
    assert (attitude.param1, attitude.param2, attitude.confirmation) == (Message.ATTITUDE, 100_000.0, 0)
    assert [getattr(attitude, f"param{number}") for number in range(3, 8)] == [0.0] * 5
    assert (time.param1, time.param2) == (Message.SYSTEM_TIME, 333_333.0)
    assert group.to_dict() == {
        "mavpackettype": "REQUEST_DATA_STREAM", "target_system": 7, "target_component": 1,
        "req_stream_id": dialect.MAV_DATA_STREAM_EXTRA1, "req_message_rate": 1, "start_stop": 1,
    }  # fmt: skip


def test_sequence_number_wraps():
    encoder = Encoder(COMPONENT)
    numbers = [decode_sent(encoder.heartbeat(1)).get_seq() for _ in range(258)]
    assert numbers[254:] == [254, 255, 0, 1]
