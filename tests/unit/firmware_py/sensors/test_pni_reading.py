"""Values of DATA frames of a PNI module, their ranges, and decoded captures."""

import math

import pytest

from firmware_py.sensors import pni_protocol
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.pni_protocol import Frame
from firmware_py.sensors.pni_reading import CAPTURE_FORMAT, read_data


def read(frame):
    return read_data(pni_protocol.payload(frame))


def test_reading_of_all_components(pni_heading):
    reading = read(pni_heading(98.5, distortion=1))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.roll_deg) == (98.5, 1.5, -2.5)
    assert (reading.temperature_c, reading.distortion) == (18.0, True)


def test_missing_component_is_none():
    reading = read_data(bytes.fromhex("010800"))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.distortion) == (None, None, False)


@pytest.mark.parametrize(
    "values",
    [(math.nan,), (math.inf,), (-0.1,), (360.1,), (1e30,), (1.0, 90.1), (1.0, -90.1), (1.0, math.nan),
     (1.0, 0.0, -180.1), (1.0, 0.0, 180.1), (1.0, 0.0, 0.0, 0, math.nan), (1.0, 0.0, 0.0, 0, -100.1),
     (1.0, 0.0, 0.0, 0, 150.1)],
)  # fmt: skip
def test_values_out_of_range_are_rejected(pni_heading, values):
    with pytest.raises(MessageError) as rejected:
        read(pni_heading(*values))
    assert rejected.value.error == "range"


@pytest.mark.parametrize("values", [(0.0, -90.0, -180.0, 0, -100.0), (360.0, 90.0, 180.0, 0, 150.0)])
def test_values_at_their_limits_are_accepted(pni_heading, values):
    reading = read(pni_heading(*values))
    assert (reading.heading_magnetic_deg, reading.pitch_deg, reading.roll_deg) == values[:3]
    assert (reading.distortion, reading.temperature_c) == values[3:]


def test_malformed_data_is_rejected():
    with pytest.raises(MessageError) as rejected:
        read_data(b"\x05")
    assert rejected.value.error == "malformed"


def test_decoded_capture(pni, pni_heading):
    capture = (
        pni(Frame.MODULE_INFO, b"TCM \x1f~\x7f8")
        + pni_heading(98.5)
        + b"junk"
        + pni_heading(math.nan)
        + pni(Frame.SET_CONFIG_DONE)
        + pni_heading(1.0)[:-1]
    )
    assert list(CAPTURE_FORMAT.decode(capture)) == [
        {"line": 1, "offset": 0, "type": "module_info", "frame_id": 2, "module": "TCM ?~?8"},
        {"line": 2, "offset": 13, "type": "heading", "frame_id": 5, "heading_magnetic_deg": 98.5, "pitch_deg": 1.5,
         "roll_deg": -2.5, "temperature_c": 18.0, "distortion": False, "magnetic_deg": 98.5},
        {"line": 3, "offset": 41, "type": "error", "error": "malformed", "bytes": 4},
        {"line": 4, "offset": 45, "type": "error", "error": "range", "detail": "heading nan out of range"},
        {"line": 5, "offset": 73, "type": "other", "frame_id": 19},
        {"line": 6, "offset": 78, "type": "error", "error": "checksum", "bytes": 27},
    ]  # fmt: skip
