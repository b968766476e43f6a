"""PNI frames compared with the manuals and public sources, and the values of DATA frames."""

import json
import math
import struct

import pytest

from firmware_py.sensors import pni_protocol
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.pni_reading import read_data

# GetModInfo, GetData, StartCal, SetDataComponents, StartContinuous, SetAcqParams, and the ModInfoResp of the manual's
# example. Newer manuals print TRAX in this example, but its CRC is that of TCM5.
VECTORS = [
    (1, "", "000501EFD4"),
    (4, "", "000504BF71"),
    (10, "00000014", "00090A000000145CF9"),
    (3, "0405181908", "000A030405181908DACC"),
    (21, "", "000515BD61"),
    (24, "0000000000003DCCCCCD", "000F180000000000003DCCCCCDF971"),
    (2, "54434D3531323038", "000D0254434D3531323038C787"),
]


@pytest.mark.parametrize(("frame_id", "payload", "packet"), VECTORS)
def test_frames_of_the_manuals_are_encoded_and_decoded(frame_id, payload, packet):
    payload, packet = bytes.fromhex(payload), bytes.fromhex(packet)
    assert pni_protocol.encode(frame_id, payload) == packet
    (message,) = pni_protocol.create_framer().feed(packet)
    assert message.fault == ""
    assert (pni_protocol.frame_id(message.data), pni_protocol.payload(message.data)) == (frame_id, payload)


def test_frames_of_the_recordings_are_valid(recordings):
    for row in json.loads((recordings / "pni_tcm_vectors.json").read_text())["frames"]:
        (message,) = pni_protocol.create_framer().feed(bytes.fromhex(row["hex"]))
        assert message.fault == ""


def test_data_with_all_components():
    floats = (5, 7, 21, 22, 23, 24, 25, 27, 28, 29, 74, 75, 76)
    payload = bytes([len(floats) + 4]) + b"".join(struct.pack(">Bf", number, 0.5 * number) for number in floats)
    payload += bytes([77, *range(16), 79, 2, 8, 1, 9, 0])
    values = {number: 0.5 * number for number in floats} | {79: 2, 8: 1, 9: 0}  # without the quaternion
    assert pni_protocol.parse_data(payload) == values


@pytest.mark.parametrize("payload", ["", "01", "0105", "0105000000", "010500000000FF", "0106", "0205000000", "FF0800"])
def test_malformed_data_is_none(payload):
    assert pni_protocol.parse_data(bytes.fromhex(payload)) is None


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
