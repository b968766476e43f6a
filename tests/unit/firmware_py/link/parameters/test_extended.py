"""The extended parameter protocol."""

import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SetParameter
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import INDEX, TABLE
from support.link import without_unasked

ACCEPTED, VALUE_UNSUPPORTED, FAILED = 0, 1, 2
LAYOUTS = {6: "<i", 9: "<f"}


def number_in(message):
    return struct.unpack_from(LAYOUTS[message.param_type], message._param_value_raw.ljust(8, b"\0"))[0]


def set_to(name, value, kind=9):
    return mavlink.MAVLink_param_ext_set_message(1, 1, name, value, kind)


def read(name, index=-1):
    return mavlink.MAVLink_param_ext_request_read_message(1, 1, name, index)


def test_the_list_is_whole(rig, of):
    replies = of(rig.tell(mavlink.MAVLink_param_ext_request_list_message(1, 1)) + rig.ticks(3), "PARAM_EXT_VALUE")
    assert [value.param_id for value in replies] == [row.name for row in TABLE]
    assert [value.param_index for value in replies] == list(range(len(TABLE)))
    assert {value.param_count for value in replies} == {len(TABLE)}
    assert [number_in(value) for value in replies] == pytest.approx(list(rig.request_handler.values.values()))
    assert [value.param_type for value in replies] == [row.kind for row in TABLE]


def test_a_list_on_a_very_slow_line_silences_no_peer(make_rig, of):
    rig = make_rig(byte_rate=1200.0, radio=True)
    rig.tick()
    rig.tell(mavlink.MAVLink_param_ext_request_list_message(1, 1))
    replies = without_unasked(rig.ticks(50))
    assert len(of(replies, "PARAM_EXT_VALUE")) == pytest.approx(0.7 * 1200.0 * 5.0 / 174.0, abs=3)
    assert len(of(replies, "HEARTBEAT")) == pytest.approx(5, abs=1)
    assert len(of(replies, "ATTITUDE")) > 0
    replies += rig.ticks(250)
    assert [value.param_index for value in of(replies, "PARAM_EXT_VALUE")] == list(range(len(TABLE)))


def test_reading_by_name_and_by_index(rig):
    (named,) = rig.tell(read(b"CTL_K1"))
    (numbered,) = rig.tell(read(b"", INDEX["CTL_K1"]))
    for value in (named, numbered):
        assert (value.param_id, number_in(value), value.param_index) == ("CTL_K1", 40.0, INDEX["CTL_K1"])


@pytest.mark.parametrize(("name", "index"), [(b"NOPE", -1), (b"", -1), (b"", 999), (b"CTL_K1", -2)])
def test_what_does_not_exist_is_said_not_to(rig, name, index):
    (error,) = rig.tell(read(name, index))
    assert (error.get_type(), error.error, error.param_index) == ("PARAM_ERROR", 1, index)


@pytest.mark.parametrize(
    ("value", "kind"), [(struct.pack("<f", 41.0), 9), (struct.pack("<d", 41.0), 10), (b"\x29", 1), (b"\x29\0\0\0", 6)]
)
def test_a_change_is_acknowledged_when_it_is_stored_and_reported_to_everybody(rig, of, value, kind):
    rig.request_handler.at_once = False
    assert rig.tell(set_to(b"CTL_K1", value, kind)) == []
    rig.request_handler.waiting.pop()(True)
    replies = rig.replies()
    (acknowledgement,), (reports,) = of(replies, "PARAM_EXT_ACK"), of(replies, "PARAM_VALUE")
    assert (acknowledgement.param_id, acknowledgement.param_result) == ("CTL_K1", ACCEPTED)
    assert (number_in(acknowledgement), acknowledgement.param_type) == (41.0, Kind.REAL)
    assert reports.param_value == 41.0
    assert rig.request_handler.intents == [SetParameter("CTL_K1", 41.0)]


def test_what_cannot_be_stored_has_failed(rig, of):
    rig.request_handler.at_once = False
    rig.tell(set_to(b"CTL_K1", struct.pack("<f", 41.0)))
    rig.request_handler.waiting.pop()(False)
    assert [acknowledgement.param_result for acknowledgement in of(rig.replies(), "PARAM_EXT_ACK")] == [FAILED]


@pytest.mark.parametrize(
    ("name", "value", "kind", "result"),
    [
        (b"CTL_K1", struct.pack("<f", 1e30), 9, VALUE_UNSUPPORTED),
        (b"CTL_K1", struct.pack("<f", float("nan")), 9, VALUE_UNSUPPORTED),
        (b"LOOP_RATE_HZ", struct.pack("<f", 10.5), 9, VALUE_UNSUPPORTED),
        (b"STAT_BOOTCNT", struct.pack("<i", 7), 6, VALUE_UNSUPPORTED),
        (b"CTL_K1", b"forty", 11, VALUE_UNSUPPORTED),
        (b"CTL_K1", b"\x29", 0, VALUE_UNSUPPORTED),
        (b"NOPE", struct.pack("<f", 1.0), 9, FAILED),
    ],
)
def test_what_is_refused_is_acknowledged_so_and_changes_nothing(rig, of, name, value, kind, result):
    before = rig.request_handler.values
    replies = rig.tell(set_to(name, value, kind))
    (acknowledgement,) = of(replies, "PARAM_EXT_ACK")
    assert (acknowledgement.param_id, acknowledgement.param_result) == (name.decode(), result)
    if name != b"NOPE":
        assert number_in(acknowledgement) == before[name.decode()]  # what is, as it is
    assert rig.request_handler.values is before


def test_changes_under_way_are_bounded_together_with_those_of_the_usual_protocol(rig):
    rig.request_handler.at_once = False
    for number in range(100):
        rig.tell(set_to(b"CTL_K1", struct.pack("<f", number)))
        rig.tell(mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", 100.0 + number, 9))
    assert len(rig.request_handler.waiting) == 32
