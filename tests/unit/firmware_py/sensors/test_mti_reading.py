"""What a data message of an MTi says of the boat, by the manual's words on frames and turns."""

import math
import struct

import pytest

from firmware_py.sensors.message_error import MALFORMED, RANGE, MessageError
from firmware_py.sensors.mti_protocol import Frame, encode
from firmware_py.sensors.mti_reading import CAPTURE_FORMAT, read_data, status_fault

GOOD = 0x03  # self-test passed, filter valid


def item(identifier, value):
    return struct.pack(">HB", identifier, len(value)) + value


def floats(*values):
    return struct.pack(f">{len(values)}f", *values)


def euler(roll, pitch, yaw, identifier=0x2034):
    return item(identifier, floats(roll, pitch, yaw))


def status(word):
    return item(0xE020, word.to_bytes(4, "big"))


def test_in_ned_yaw_is_the_heading():
    reading = read_data(status(GOOD) + euler(-178.0, 1.5, -90.5) + item(0x0810, floats(18.5)))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.temperature_c) == (269.5, 1.5, 18.5)
    assert reading.roll_deg == 2.0  # the label is up: half a turn of roll is the mounting, not the boat
    assert (reading.yaw_rate_deg_s, reading.is_valid, reading.fault) == (None, True, "")


@pytest.mark.parametrize(
    ("device", "boat"), [(0.0, 0.0), (25.0, 25.0), (-25.0, -25.0), (-155.0, 25.0), (155.0, -25.0), (180.0, 0.0)]
)
def test_the_boat_s_roll_is_upright_whichever_side_of_the_device_is_up(device, boat):
    assert read_data(euler(device, 0.0, 0.0)).roll_deg == boat


@pytest.mark.parametrize(("identifier", "frame"), [(0x2030, Frame.ENU), (0x2038, Frame.NWU)])
def test_other_frames_are_named_and_give_no_heading(identifier, frame):
    reading = read_data(status(GOOD) + euler(1.0, 2.0, 3.0, identifier))
    assert (reading.frame, reading.heading_magnetic_deg, reading.roll_deg) == (frame, None, None)


def test_a_frame_that_does_not_exist_is_malformed():
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
def test_every_precision_is_read(precision, value):
    reading = read_data(item(0x2034 | precision, value))
    assert (reading.roll_deg, reading.pitch_deg, reading.heading_magnetic_deg) == (2.0, 1.5, 98.25)


def test_a_small_negative_fixed_point_rate_keeps_its_sign():
    """A quarter below zero is the whole part minus one and a fraction of three quarters."""
    reading = read_data(euler(0.0, 0.0, 0.0) + item(0x8022, bytes.fromhex("000000000000 000000000000 C0000000FFFF")))
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(-0.25))


@pytest.mark.parametrize(("roll", "gyroscope"), [(0.0, 0.1), (180.0, -0.1), (-180.0, -0.1)])
def test_a_turn_to_starboard_is_positive_with_the_label_up_or_down(roll, gyroscope):
    reading = read_data(euler(roll, 0.0, 10.0) + item(0x8020, floats(0.0, 0.0, gyroscope)))
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(0.1))


def test_the_rate_of_a_heeled_device_is_that_of_the_heading():
    """30 degrees of heel and a turn about the vertical: the gyroscopes see it in y and z."""
    seen = 0.1 * math.sin(math.radians(30.0)), 0.1 * math.cos(math.radians(30.0))
    reading = read_data(euler(30.0, 0.0, 10.0) + item(0x8020, floats(0.0, *seen)))
    assert reading.yaw_rate_deg_s == pytest.approx(math.degrees(0.1))


def test_no_rate_where_it_means_nothing():
    turn = item(0x8020, floats(0.0, 0.0, 0.1))
    assert read_data(euler(0.0, 81.0, 0.0) + turn).yaw_rate_deg_s is None
    assert read_data(status(GOOD | 1 << 13) + euler(0.0, 0.0, 0.0) + turn).yaw_rate_deg_s is None
    assert read_data(status(GOOD | 1 << 16) + euler(0.0, 0.0, 0.0) + turn).yaw_rate_deg_s is not None


@pytest.mark.parametrize(
    ("word", "text"),
    [
        (0x03, ""),
        (0x0180_0047, ""),  # filter profile, clock: nothing against it
        (0x01, "orientation not valid"),
        (0x02, "self-test failed"),
        (0x03 | 1 << 8, "out of range: accelerometer"),
        (0x02 | 1 << 12 | 1 << 16, "self-test failed; out of range: gyroscope, magnetometer"),
    ],
)
def test_the_status_word_in_plain_text(word, text):
    assert status_fault(word) == text


def test_only_a_stated_good_status_is_believed():
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
        (item(0x8020, floats(0.0, 41.0, 0.0)), RANGE),
        (item(0x0810, floats(-101.0)), RANGE),
        (item(0x2034, floats(0.0, 0.0)), MALFORMED),
        (item(0x2037, floats(0.0, 0.0, 0.0)), MALFORMED),  # three floats where three doubles belong
        (item(0xE020, b"\0\0\3"), MALFORMED),
    ],
)
def test_what_cannot_be_is_refused(data, error):
    with pytest.raises(MessageError) as refused:
        read_data(status(GOOD) + data)
    assert refused.value.error == error


def test_what_is_not_known_is_passed_over():
    reading = read_data(item(0x4020, floats(9.8, 0.0, 0.0)) + item(0x7010, bytes(94)) + status(GOOD))
    assert (reading.frame, reading.status) == (None, GOOD)


def test_a_capture_is_decoded_message_by_message():
    status = struct.pack(">HBI", 0xE020, 4, 0x0002)
    euler = struct.pack(">HB3f", 0x2034, 12, 178.0, 1.5, -90.0)
    enu = struct.pack(">HB3f", 0x2030, 12, 0.0, 0.0, 0.0)
    sent = ((0x3E, b""), (0x36, status + euler), (0x36, status + enu), (0x42, b"\x21"), (0x36, b"\xe0\x20\x04"))
    capture = b"".join(encode(message, data) for message, data in sent)
    results = list(CAPTURE_FORMAT.decode(capture + b"junk"))
    assert results == [
        {"line": 1, "offset": 0, "type": "other", "message": "WAKE_UP"},
        {"line": 2, "offset": 5, "type": "heading", "message": "MT_DATA2", "frame": "NED",
         "heading_magnetic_deg": 270.0, "pitch_deg": 1.5, "roll_deg": -2.0, "yaw_rate_deg_s": None,
         "temperature_c": None, "status": "00000002", "magnetic_deg": 270.0, "fault": "self-test failed"},
        {"line": 3, "offset": 32, "type": "other", "message": "MT_DATA2", "frame": "ENU", "status": "00000002"},
        {"line": 4, "offset": 59, "type": "other", "message": "ERROR", "text": "device error 33: parameter invalid"},
        {"line": 5, "offset": 65, "type": "error", "error": "malformed", "detail": "data message malformed"},
        {"line": 6, "offset": 73, "type": "error", "error": "malformed", "bytes": 4},
    ]  # fmt: skip
