"""The parameter protocol."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.intents import SetParameter
from firmware_py.params import INDEX, TABLE, Kind

UNKNOWN, OUT_OF_RANGE = 1, 2


def set_to(name, value, kind=9, target=(1, 1)):
    return mavlink.MAVLink_param_set_message(*target, name, value, kind)


@pytest.mark.parametrize("component", [0, 1])
def test_the_list_is_whole(rig, of, component):
    said = rig.tell(mavlink.MAVLink_param_request_list_message(1, component))
    said += of(rig.ticks(3), "PARAM_VALUE")
    assert [value.param_id for value in said] == [row.name for row in TABLE]
    assert [value.param_index for value in said] == list(range(len(TABLE)))
    assert {value.param_count for value in said} == {len(TABLE)}
    assert [value.param_value for value in said] == list(rig.authority.values.values())
    assert {value.param_type for value in said} == {6, 9}
    assert all(value.param_type == row.kind for value, row in zip(said, TABLE, strict=True))


def test_reading_by_name_and_by_index(rig):
    (named,) = rig.tell(mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1))
    (numbered,) = rig.tell(mavlink.MAVLink_param_request_read_message(1, 1, b"", INDEX["CTL_K1"]))
    for value in (named, numbered):
        assert (value.param_id, value.param_value, value.param_index) == ("CTL_K1", 40.0, INDEX["CTL_K1"])


@pytest.mark.parametrize(("name", "index"), [(b"NOPE", -1), (b"", -1), (b"", 999), (b"CTL_K1", -2), (b"\xff" * 16, -1)])
def test_what_does_not_exist_is_said_not_to(rig, name, index):
    (error,) = rig.tell(mavlink.MAVLink_param_request_read_message(1, 1, name, index))
    assert (error.get_type(), error.error, error.param_index) == ("PARAM_ERROR", UNKNOWN, index)


def test_a_change_is_confirmed_to_everybody(make_rig, of):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    rig.transport.inbox.append(("one", rig.frame(set_to(b"CTL_K1", 41.5))))
    rig.endpoint.service(rig.now_s, [100])
    sent = list(rig.transport.sent)
    for address in ("one", "two"):
        rig.transport.sent = list(sent)
        (value,) = of(rig.said(address), "PARAM_VALUE")
        assert (value.param_id, value.param_value) == ("CTL_K1", 41.5)
    assert rig.authority.intents == [SetParameter("CTL_K1", 41.5)]


def test_a_change_is_confirmed_only_when_it_is_stored(rig):
    rig.authority.at_once = False
    assert rig.tell(set_to(b"CTL_K1", 41.5)) == []
    rig.authority.waiting.pop()(True)
    (value,) = rig.said()
    assert (value.param_id, value.param_value) == ("CTL_K1", 41.5)


def test_a_change_that_cannot_be_stored_is_not_confirmed_but_told(rig, texts):
    rig.authority.at_once = False
    rig.tell(set_to(b"CTL_K1", 41.5))
    rig.authority.waiting.pop()(False)
    assert texts(rig.said()) == ["CTL_K1 is in force but could not be stored"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.4e38, -1.0, 200.5])
def test_a_refused_value_is_answered_with_the_unchanged_one_and_a_reason(rig, texts, of, value):
    said = rig.tell(set_to(b"CTL_K1", value))
    (error,) = of(said, "PARAM_ERROR")
    assert (error.error, error.param_id, error.target_system) == (OUT_OF_RANGE, "CTL_K1", 255)
    (unchanged,) = of(said, "PARAM_VALUE")
    assert unchanged.param_value == 40.0
    assert "0 to 200" in texts(said)[0]
    assert rig.authority.values["CTL_K1"] == 40.0


def test_an_integer_sent_bytewise_is_refused(rig, of):
    assert of(rig.tell(set_to(b"LOOP_RATE_HZ", 2.8e-44, kind=6)), "PARAM_ERROR")
    assert TABLE[INDEX["LOOP_RATE_HZ"]].kind is Kind.INTEGER
    assert rig.authority.values["LOOP_RATE_HZ"] == 10


@pytest.mark.parametrize("target", [(2, 1), (1, 7)])
def test_somebody_elses_parameters_are_left_alone(rig, target):
    assert rig.tell(set_to(b"CTL_K1", 41.5, target=target)) == []
    assert rig.authority.requests == []


def test_an_unknown_name_is_not_put_to_the_loop(rig):
    (error,) = rig.tell(set_to(b"NOPE", 1.0))
    assert (error.error, error.param_id) == (UNKNOWN, "NOPE")
    assert rig.authority.requests == []


def test_changes_under_way_are_bounded(rig):
    rig.authority.at_once = False
    for number in range(500):
        rig.tell(set_to(b"CTL_K1", number % 100))
    assert len(rig.authority.waiting) <= 64
    waiting, rig.authority.waiting = rig.authority.waiting, []
    for call in waiting:
        call(True)
    rig.said()
    rig.tell(set_to(b"CTL_K1", 7.0))
    assert rig.authority.values["CTL_K1"] == 7.0


def test_the_list_is_paced_on_a_slow_line_and_still_whole(make_rig, of):
    rig = make_rig(byte_rate=960.0, radio=True)
    rig.tick()
    said = rig.tell(mavlink.MAVLink_param_request_list_message(1, 1))
    assert len(of(said, "PARAM_VALUE")) < len(TABLE)
    values, beats = [], 0
    for _ in range(100):
        said = rig.tick()
        values += of(said, "PARAM_VALUE")
        beats += len(of(said, "HEARTBEAT"))
    assert values[-1].param_index == len(TABLE) - 1
    assert beats == pytest.approx(10, abs=1)


def test_a_list_on_a_very_slow_line_does_not_silence_the_heartbeat(make_rig, of):
    rig = make_rig(byte_rate=120.0, radio=True)
    rig.tick()
    rig.tell(mavlink.MAVLink_param_request_list_message(1, 1))
    said = rig.ticks(50)
    assert of(said, "PARAM_VALUE")[-1].param_index < len(TABLE) - 1
    assert len(of(said, "HEARTBEAT")) == pytest.approx(5, abs=1)
