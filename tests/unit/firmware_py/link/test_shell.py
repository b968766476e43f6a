"""Console (SERIAL_CONTROL) of a ground station."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

SHELL = mavlink.SERIAL_CONTROL_DEV_SHELL


def typed(device=SHELL, flags=mavlink.SERIAL_CONTROL_FLAG_RESPOND, text=b"help\n"):
    return mavlink.MAVLink_serial_control_message(device, flags, 0, 0, len(text), list(text.ljust(70, b"\0")))


def test_console_input_gets_the_reply_that_there_is_no_shell(rig):
    (answer,) = rig.tell(typed())
    assert (answer.device, answer.flags, answer.timeout, answer.baudrate) == (SHELL, 1, 0, 0)
    assert bytes(answer.data[: answer.count]) == b"no shell over MAVLink; log in by ssh\r\n"


@pytest.mark.parametrize(
    "more",
    [{"device": mavlink.SERIAL_CONTROL_DEV_GPS1}, {"flags": mavlink.SERIAL_CONTROL_FLAG_REPLY}, {"text": b""}],
)
def test_console_reply_is_not_answered(rig, more):
    assert rig.tell(typed(**more)) == []
