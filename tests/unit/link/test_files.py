"""File transfer is refused at once."""

import pytest
from pymavlink.dialects.v20 import common as mavlink


@pytest.mark.parametrize("opcode", [0, 1, 2, 3, 4, 15, 16, 255])
def test_every_request_gets_an_unknown_command_nak(rig, opcode):
    payload = bytes((0xFF, 0xFF, 3, opcode)) + bytes(247)
    (reply,) = rig.tell(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
    data = bytes(reply.payload)
    assert (data[0:2], data[2], data[3], data[4], data[5], data[12]) == (b"\0\0", 3, 129, 1, opcode, 7)
    assert (reply.target_system, reply.target_component) == (255, 190)


@pytest.mark.parametrize("opcode", [128, 129])
def test_answers_are_not_answered(rig, opcode):
    payload = bytes((0, 0, 0, opcode)) + bytes(247)
    assert rig.tell(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)) == []
