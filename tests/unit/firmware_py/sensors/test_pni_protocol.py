"""PNI frames against the vectors of the manuals and of public sources."""

import json
import struct

import pytest

from firmware_py.sensors import pni_protocol

# GetModInfo, GetData, StartCal, SetDataComponents, StartContinuous, SetAcqParams; the last is the module information
# of the manual's example, whose CRC is that of TCM5 although newer editions print TRAX.
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
def test_vectors_both_ways(frame_id, payload, packet):
    payload, packet = bytes.fromhex(payload), bytes.fromhex(packet)
    assert pni_protocol.encode(frame_id, payload) == packet
    (found,) = pni_protocol.framer().feed(packet)
    assert found.fault == ""
    assert (pni_protocol.frame_id(found.data), pni_protocol.payload(found.data)) == (frame_id, payload)


def test_vectors_of_the_shared_file(recordings):
    for row in json.loads((recordings / "pni_tcm_vectors.json").read_text())["frames"]:
        (found,) = pni_protocol.framer().feed(bytes.fromhex(row["hex"]))
        assert found.fault == ""


def test_components_of_every_size():
    payload = bytes([5, 77]) + bytes(16) + bytes([5]) + struct.pack(">f", 98.5) + bytes([79, 2, 8, 1, 9, 0])
    assert pni_protocol.parse_data(payload) == {5: 98.5, 79: 2, 8: 1, 9: 0}


@pytest.mark.parametrize("payload", ["", "01", "0105", "0105000000", "010500000000FF", "0106", "0205000000", "FF0800"])
def test_data_that_does_not_add_up(payload):
    assert pni_protocol.parse_data(bytes.fromhex(payload)) is None
