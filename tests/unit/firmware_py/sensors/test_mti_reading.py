"""Values of MTi data messages: frames, precisions, signs, ranges and status."""

import math
import struct

import pytest

from firmware_py.sensors.message_error import MALFORMED, RANGE, MessageError
from firmware_py.sensors.mti_protocol import Frame, Message, encode
from firmware_py.sensors.mti_reading import CAPTURE_FORMAT, read_data, status_fault_text

GOOD = 0x03  # self-test passed, filter valid
# Data identifiers: Euler angles in NED, ENU and NWU as floats, rate of turn, temperature, status word.
EULER_NED, EULER_ENU, EULER_NWU, RATE_OF_TURN, TEMPERATURE, STATUS_WORD = 0x2034, 0x2030, 0x2038, 0x8020, 0x0810, 0xE020


def item(identifier, value):
    return struct.pack(">HB", identifier, len(value)) + value


def floats(*values):
    return struct.pack(f">{len(values)}f", *values)


def euler(roll, pitch, yaw, identifier=EULER_NED):
    return item(identifier, floats(roll, pitch, yaw))


def status(word):
    return item(STATUS_WORD, word.to_bytes(4, "big"))


def test_yaw_in_ned_is_the_heading():
    reading = read_data(status(GOOD) + euler(-178.0, 1.5, -90.5) + item(TEMPERATURE, floats(18.5)))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.temperature_c) == (269.5, 1.5, 18.5)
    assert reading.roll_deg == 2.0  # the label is up
    assert (reading.yaw_rate_deg_s, reading.is_valid, reading.fault) == (None, True, "")


@pytest.mark.parametrize(
    ("device", "boat"),
    [
        (0.0, 0.0),
        (25.0, 25.0),
        (-25.0, -25.0),
        (-155.0, 25.0),
        (155.0, -25.0),
        (180.0, 0.0),
        (90.0, 90.0),
        (-90.0, -90.0),
        (95.0, -85.0),
        (-95.0, 85.0),
    ],
)
def test_roll_of_the_boat_does_not_depend_on_the_mounting(device, boat):
    assert read_data(euler(device, 0.0, 0.0)).roll_deg == boat


@pytest.mark.parametrize(("identifier", "frame"), [(EULER_ENU, Frame.ENU), (EULER_NWU, Frame.NWU)])
def test_other_frames_give_no_heading(identifier, frame):
    reading = read_data(status(GOOD) + euler(1.0, 2.0, 3.0, identifier))
    assert (reading.frame, reading.heading_magnetic_deg, reading.roll_deg) == (frame, None, None)


def test_unknown_frame_is_malformed():
    with pytest.raises(MessageError, match="frame"):
        read_data(euler(0.0, 0.0, 0.0, 0x203C))


@pytest.mark.parametrize(
    ("precision", "value"),
    [
        (0, struct.pack(">3f", -178.0, 1.5, 98.25)),
        (1, struct.pack(">3i", -178 << 20, 3 << 19, 393 << 18)),
        (2, bytes.fromhex("00000000FF4E 800000000001 400000000062")),  # the fraction comes first
        (3, struct.pack(">3d", -178.0, 1.5, 98.25)),
    ],
)
def test_precisions(precision, value):
    reading = read_data(item(EULER_NED | precision, value))
    assert (reading.roll_deg, reading.pitch_deg, reading.heading_magnetic_deg) == (2.0, 1.5, 98.25)


def test_small_negative_fixed_point_rate():
    # -0.25 has the integer part -1 and the fraction 0.75.
    reading = read_data(
        euler(0.0, 0.0, 0.0) + item(RATE_OF_TURN | 2, bytes.fromhex("000000000000 000000000000 C0000000FFFF"))
    )
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(-0.25))


@pytest.mark.parametrize(("roll", "gyroscope"), [(0.0, 0.1), (180.0, -0.1), (-180.0, -0.1)])
def test_turn_to_starboard_is_positive_for_both_mountings(roll, gyroscope):
    reading = read_data(euler(roll, 0.0, 10.0) + item(RATE_OF_TURN, floats(0.0, 0.0, gyroscope)))
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(0.1))


def test_yaw_rate_of_a_heeled_device_is_about_the_vertical():
    y_and_z = 0.1 * math.sin(math.radians(30.0)), 0.1 * math.cos(math.radians(30.0))
    reading = read_data(euler(30.0, 0.0, 10.0) + item(RATE_OF_TURN, floats(0.0, *y_and_z)))
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(0.1))


def test_no_yaw_rate_near_vertical_or_with_a_clipped_gyroscope():
    turn = item(RATE_OF_TURN, floats(0.0, 0.0, 0.1))
    assert read_data(euler(0.0, 81.0, 0.0) + turn).yaw_rate_deg_s is None
    assert read_data(status(GOOD | 1 << 13) + euler(0.0, 0.0, 0.0) + turn).yaw_rate_deg_s is None
    assert read_data(status(GOOD | 1 << 16) + euler(0.0, 0.0, 0.0) + turn).yaw_rate_deg_s is not None


@pytest.mark.parametrize(
    ("word", "text"),
    [
        (0x03, ""),
        (0x0180_0047, ""),  # filter profile and clock bits are no faults
        (0x01, "orientation not valid"),
        (0x02, "self-test failed"),
        (0x03 | 1 << 8, "out of range: accelerometer"),
        (0x02 | 1 << 12 | 1 << 16, "self-test failed; out of range: gyroscope, magnetometer"),
    ],
)
def test_text_of_the_status_word(word, text):
    assert status_fault_text(word) == text


def test_orientation_is_valid_only_if_the_status_says_so():
    assert not read_data(euler(0.0, 0.0, 0.0)).is_valid
    assert not read_data(euler(0.0, 0.0, 0.0) + status(0x01)).is_valid
    assert read_data(euler(0.0, 0.0, 0.0) + status(0x02)).is_valid


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (euler(180.1, 0.0, 0.0), RANGE),
        (euler(0.0, -90.1, 0.0), RANGE),
        (euler(0.0, 0.0, math.nan), RANGE),
        (euler(0.0, 0.0, math.inf), RANGE),
        (item(RATE_OF_TURN, floats(0.0, 41.0, 0.0)), RANGE),
        (item(TEMPERATURE, floats(-101.0)), RANGE),
        (item(EULER_NED, floats(0.0, 0.0)), MALFORMED),
        (item(EULER_NED | 3, floats(0.0, 0.0, 0.0)), MALFORMED),  # floats with the identifier of doubles
        (item(STATUS_WORD, b"\0\0\3"), MALFORMED),
    ],
)
def test_invalid_values_are_rejected(data, error):
    with pytest.raises(MessageError) as rejected:
        read_data(status(GOOD) + data)
    assert rejected.value.error == error


def test_unknown_items_are_ignored():
    reading = read_data(item(0x4020, floats(9.8, 0.0, 0.0)) + item(0x7010, bytes(94)) + status(GOOD))
    assert (reading.frame, reading.status) == (None, GOOD)


def test_decoded_capture():
    values = status(0x02) + euler(178.0, 1.5, -90.0)
    enu = status(0x02) + euler(0.0, 0.0, 0.0, EULER_ENU)
    sent = (
        (Message.WAKE_UP, b""), (Message.MT_DATA2, values), (Message.MT_DATA2, enu), (Message.ERROR, b"\x21"),
        (Message.MT_DATA2, b"\xe0\x20\x04"),
    )  # fmt: skip
    capture = b"".join(encode(message, data) for message, data in sent)
    assert list(CAPTURE_FORMAT.decode(capture + b"junk")) == [
        {"line": 1, "offset": 0, "type": "other", "message": "WAKE_UP"},
        {"line": 2, "offset": 5, "type": "heading", "message": "MT_DATA2", "frame": "NED",
         "heading_magnetic_deg": 270.0, "pitch_deg": 1.5, "roll_deg": -2.0, "yaw_rate_deg_s": None,
         "temperature_c": None, "status": "00000002", "magnetic_deg": 270.0, "fault": "self-test failed"},
        {"line": 3, "offset": 32, "type": "other", "message": "MT_DATA2", "frame": "ENU", "status": "00000002"},
        {"line": 4, "offset": 59, "type": "other", "message": "ERROR", "text": "device error 33: parameter invalid"},
        {"line": 5, "offset": 65, "type": "error", "error": "malformed", "detail": "data message malformed"},
        {"line": 6, "offset": 73, "type": "error", "error": "malformed", "bytes": 4},
    ]  # fmt: skip


def test_other_message_is_not_decoded():
    (result,) = CAPTURE_FORMAT.decode(encode(Message.DEVICE_ID, b"\1\2\3\4"))
    assert result == {"line": 1, "offset": 0, "type": "other", "message": "DEVICE_ID"}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("rate_rad_s", "is_valid"), [(40.0, True), (40.5, False)])
def test_rate_beyond_the_range_of_a_gyroscope_is_rejected(rate_rad_s, is_valid, sign):
    data = euler(0.0, 0.0, 10.0) + item(RATE_OF_TURN, floats(0.0, 0.0, sign * rate_rad_s))
    if is_valid:
        assert read_data(data).yaw_rate_deg_s == pytest.approx(sign * math.degrees(rate_rad_s))
    else:
        with pytest.raises(MessageError):
            read_data(data)


@pytest.mark.parametrize(
    ("temperature_c", "is_valid"), [(-100.0, True), (-101.0, False), (150.0, True), (151.0, False)]
)
def test_impossible_temperature_is_rejected(temperature_c, is_valid):
    data = item(TEMPERATURE, floats(temperature_c))
    if is_valid:
        assert read_data(data).temperature_c == temperature_c
    else:
        with pytest.raises(MessageError):
            read_data(data)


@pytest.mark.parametrize(
    ("angles", "is_valid"),
    [((180.0, 90.0, 180.0), True), ((-180.0, -90.0, -180.0), True), ((181.0, 0.0, 0.0), False),
     ((-181.0, 0.0, 0.0), False), ((0.0, 91.0, 0.0), False), ((0.0, -91.0, 0.0), False), ((0.0, 0.0, 181.0), False),
     ((0.0, 0.0, -181.0), False)],
)  # fmt: skip
def test_impossible_angle_is_rejected(angles, is_valid):
    if is_valid:
        assert read_data(euler(*angles)).pitch_deg == angles[1]
    else:
        with pytest.raises(MessageError):
            read_data(euler(*angles))


@pytest.mark.parametrize(("pitch_deg", "is_known"), [(80.0, True), (81.0, False), (-80.0, True), (-81.0, False)])
def test_yaw_rate_of_a_device_that_is_nearly_vertical_is_unknown(pitch_deg, is_known):
    data = euler(0.0, pitch_deg, 10.0) + item(RATE_OF_TURN, floats(0.0, 0.0, 0.5))
    assert (read_data(data).yaw_rate_deg_s is not None) is is_known
