"""The values of a data frame are judged before anybody steers by them."""

import math

import pytest

from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.pni_reading import read_data


def payload_of(frame):
    return frame[3:-2]


def test_a_reading(pni_heading):
    reading = read_data(payload_of(pni_heading(98.5, distortion=1)))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.roll_deg) == (98.5, 1.5, -2.5)
    assert (reading.temperature_c, reading.distortion) == (18.0, True)


def test_a_component_that_is_not_there_is_none():
    reading = read_data(bytes.fromhex("0108 00"))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.distortion) == (None, None, False)


@pytest.mark.parametrize(
    "values",
    [(math.nan,), (math.inf,), (-0.1,), (360.1,), (1e30,), (1.0, 90.1), (1.0, math.nan), (1.0, 0.0, -180.1),
     (1.0, 0.0, 0.0, 0, math.nan), (1.0, 0.0, 0.0, 0, 1e9)],
)  # fmt: skip
def test_values_out_of_range_are_refused(pni_heading, values):
    with pytest.raises(MessageError, match="out of range") as refusal:
        read_data(payload_of(pni_heading(*values)))
    assert refusal.value.error == "range"


def test_a_frame_that_does_not_add_up_is_refused():
    with pytest.raises(MessageError, match="malformed"):
        read_data(b"\x05")
