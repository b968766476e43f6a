"""The list of logs is empty, and said to be."""

from pymavlink.dialects.v20 import common as mavlink


def test_the_list_of_logs_is_empty(rig):
    (reply,) = rig.tell(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    assert (reply.get_type(), reply.num_logs) == ("LOG_ENTRY", 0)
