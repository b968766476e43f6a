"""PNI frames compared with test vectors of the manuals and of public sources."""

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
def test_encode_and_decode_vectors(frame_id, payload, packet):
    payload, packet = bytes.fromhex(payload), bytes.fromhex(packet)
    assert pni_protocol.encode(frame_id, payload) == packet
    (message,) = pni_protocol.framer().feed(packet)
    assert message.fault == ""
    assert (pni_protocol.frame_id(message.data), pni_protocol.payload(message.data)) == (frame_id, payload)


def test_vectors_of_the_file_are_valid(recordings):
    for row in json.loads((recordings / "pni_tcm_vectors.json").read_text())["frames"]:
        (message,) = pni_protocol.framer().feed(bytes.fromhex(row["hex"]))
        assert message.fault == ""


def test_components_of_every_size():
    payload = bytes([5, 77]) + bytes(16) + bytes([5]) + struct.pack(">f", 98.5) + bytes([79, 2, 8, 1, 9, 0])
    assert pni_protocol.parse_data(payload) == {5: 98.5, 79: 2, 8: 1, 9: 0}


@pytest.mark.parametrize("payload", ["", "01", "0105", "0105000000", "010500000000FF", "0106", "0205000000", "FF0800"])
def test_malformed_data(payload):
    assert pni_protocol.parse_data(bytes.fromhex(payload)) is None
