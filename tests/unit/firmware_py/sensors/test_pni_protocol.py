"""PNI frames compared with the manuals and public sources."""

import json
import struct

import pytest

from firmware_py.sensors import pni_protocol

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
    # Component ids; one more, the quaternion 77, is skipped.
    floats = (5, 7, 21, 22, 23, 24, 25, 27, 28, 29, 74, 75, 76)
    payload = bytes([len(floats) + 4]) + b"".join(struct.pack(">Bf", number, 0.5 * number) for number in floats)
    payload += bytes([77, *range(16), 79, 2, 8, 1, 9, 0])
    values = {number: 0.5 * number for number in floats} | {79: 2, 8: 1, 9: 0}  # without the quaternion
    assert pni_protocol.parse_data(payload) == values


@pytest.mark.parametrize(
    "payload", ["", "01", "0105", "0105000000", "010500000000FF", "0106", "010600", "0205000000", "FF0800"]
)
def test_malformed_data_is_none(payload):
    assert pni_protocol.parse_data(bytes.fromhex(payload)) is None
