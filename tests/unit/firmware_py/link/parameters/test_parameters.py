"""The parameter protocol."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SetParameter
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import INDEX, TABLE
from support.link import without_unasked

UNKNOWN, OUT_OF_RANGE = 1, 2


def set_to(name, value, kind=9, target=(1, 1)):
    return mavlink.MAVLink_param_set_message(*target, name, value, kind)


@pytest.mark.parametrize("component", [0, 1])
def test_the_list_is_whole(rig, of, component):
    replies = rig.tell(mavlink.MAVLink_param_request_list_message(1, component))
    replies += of(rig.ticks(3), "PARAM_VALUE")
    assert [value.param_id for value in replies] == [row.name for row in TABLE]
    assert [value.param_index for value in replies] == list(range(len(TABLE)))
    assert {value.param_count for value in replies} == {len(TABLE)}
    assert [value.param_value for value in replies] == list(rig.request_handler.values.values())
    assert {value.param_type for value in replies} == {6, 9}
    assert all(value.param_type == row.kind for value, row in zip(replies, TABLE, strict=True))


def test_for_another_identity_every_type_is_a_float(make_rig, of):
    rig = make_rig(identity=0)
    replies = without_unasked(rig.tell(mavlink.MAVLink_param_request_list_message(1, 1)) + rig.ticks(3))
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == list(rig.request_handler.values.values())
    assert {value.param_type for value in of(replies, "PARAM_VALUE")} == {9}
    for kind in (6, 9):
        (value,) = of(rig.tell(set_to(b"LOOP_RATE_HZ", 10.0 + kind, kind)), "PARAM_VALUE")
        assert (value.param_value, value.param_type) == (10.0 + kind, 9)


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
        (value,) = of(rig.replies(address), "PARAM_VALUE")
        assert (value.param_id, value.param_value) == ("CTL_K1", 41.5)
    assert rig.request_handler.intents == [SetParameter("CTL_K1", 41.5)]


def test_a_change_is_confirmed_only_when_it_is_stored(rig):
    rig.request_handler.at_once = False
    assert rig.tell(set_to(b"CTL_K1", 41.5)) == []
    rig.request_handler.waiting.pop()(True)
    (value,) = rig.replies()
    assert (value.param_id, value.param_value) == ("CTL_K1", 41.5)


def test_a_change_that_cannot_be_stored_is_not_confirmed_but_reported(rig, texts):
    rig.request_handler.at_once = False
    rig.tell(set_to(b"CTL_K1", 41.5))
    rig.request_handler.waiting.pop()(False)
    assert texts(rig.replies()) == ["CTL_K1 is in force but could not be stored"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.4e38, -1.0, 200.5])
def test_a_refused_value_is_answered_with_the_unchanged_one_and_a_reason(rig, texts, of, value):
    replies = rig.tell(set_to(b"CTL_K1", value))
    (error,) = of(replies, "PARAM_ERROR")
    assert (error.error, error.param_id, error.target_system) == (OUT_OF_RANGE, "CTL_K1", 255)
    # The first one pymavlink takes for what it has asked for; by the second it knows what is.
    assert [unchanged.param_value for unchanged in of(replies, "PARAM_VALUE")] == [40.0, 40.0]
    assert "0 to 200" in texts(replies)[0]
    assert rig.request_handler.values["CTL_K1"] == 40.0


def test_an_integer_sent_bytewise_is_refused(rig, of):
    assert of(rig.tell(set_to(b"LOOP_RATE_HZ", 2.8e-44, kind=6)), "PARAM_ERROR")
    assert TABLE[INDEX["LOOP_RATE_HZ"]].kind is Kind.INTEGER
    assert rig.request_handler.values["LOOP_RATE_HZ"] == 10


@pytest.mark.parametrize("target", [(2, 1), (1, 7)])
def test_someone_elses_parameters_are_left_alone(rig, target):
    assert rig.tell(set_to(b"CTL_K1", 41.5, target=target)) == []
    assert rig.request_handler.requests == []


def test_an_unknown_name_is_not_put_to_the_loop(rig):
    (error,) = rig.tell(set_to(b"NOPE", 1.0))
    assert (error.error, error.param_id) == (UNKNOWN, "NOPE")
    assert rig.request_handler.requests == []


def test_changes_under_way_are_bounded(rig):
    rig.request_handler.at_once = False
    for number in range(500):
        rig.tell(set_to(b"CTL_K1", number % 100))
    assert len(rig.request_handler.waiting) <= 64
    waiting, rig.request_handler.waiting = rig.request_handler.waiting, []
    for call in waiting:
        call(True)
    rig.replies()
    rig.tell(set_to(b"CTL_K1", 7.0))
    assert rig.request_handler.values["CTL_K1"] == 7.0


def test_one_station_s_changes_without_end_do_not_shut_out_another_s(make_rig):
    rig = make_rig(addresses=("mad", "sound"))
    rig.request_handler.at_once = False
    for number in range(200):
        rig.tell(mavlink.MAVLink_param_set_message(1, 1, b"LOIT_RADIUS", 50.0 + number, 9), address="mad")
    waiting = len(rig.request_handler.waiting)
    rig.tell(mavlink.MAVLink_param_set_message(1, 1, b"RUD_LIMIT_DEG", 20.0, 9), address="sound")
    assert len(rig.request_handler.waiting) == waiting + 1
    assert rig.request_handler.values["RUD_LIMIT_DEG"] == 20.0
    for call in rig.request_handler.waiting:
        call(True)
    rig.request_handler.waiting.clear()
    rig.tell(mavlink.MAVLink_param_set_message(1, 1, b"LOIT_RADIUS", 20.0, 9), address="mad")
    assert rig.request_handler.values["LOIT_RADIUS"] == 20.0


def test_the_list_is_paced_on_a_slow_line_and_still_whole(make_rig, of):
    rig = make_rig(byte_rate=960.0, radio=True)
    rig.tick()
    replies = rig.tell(mavlink.MAVLink_param_request_list_message(1, 1))
    assert len(of(replies, "PARAM_VALUE")) < len(TABLE)
    values, beats = [], 0
    for _ in range(100):
        replies = without_unasked(rig.tick())
        values += of(replies, "PARAM_VALUE")
        beats += len(of(replies, "HEARTBEAT"))
    assert values[-1].param_index == len(TABLE) - 1
    assert beats == pytest.approx(10, abs=1)


def test_a_list_on_a_very_slow_line_does_not_silence_the_heartbeat(make_rig, of):
    rig = make_rig(byte_rate=120.0, radio=True)
    rig.tick()
    rig.tell(mavlink.MAVLink_param_request_list_message(1, 1))
    replies = without_unasked(rig.ticks(50))
    assert of(replies, "PARAM_VALUE")[-1].param_index < len(TABLE) - 1
    assert len(of(replies, "HEARTBEAT")) == pytest.approx(5, abs=1)


@pytest.mark.parametrize("spare", [b"", b"\0"])
def test_a_name_as_long_as_the_field_needs_no_end(rig, monkeypatch, spare):
    name = "A_NAME_OF_SIXTEEN"[:16]
    monkeypatch.setitem(INDEX, name, 3)
    (value,) = rig.tell(mavlink.MAVLink_param_request_read_message(1, 1, (name.encode() + spare)[:16], -1))
    assert value.param_index == 3


def test_a_value_that_is_in_force_already_is_confirmed_without_being_set_again(rig, of):
    rig.request_handler.at_once = False
    assert rig.tell(set_to(b"CTL_K1", 40.0)) == []
    rig.request_handler.waiting.pop()(True)  # what is under way may be an earlier change to the same value
    (value,) = of(rig.replies(), "PARAM_VALUE")
    assert (value.param_id, value.param_value) == ("CTL_K1", 40.0)
    assert rig.request_handler.requests == []


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_the_fence_is_enabled_again_since_a_command_may_have_overruled_it(rig, of, value):
    rig.tell(set_to(b"FENCE_ENABLE", value, kind=6))
    (reports,) = of(rig.tell(set_to(b"FENCE_ENABLE", value, kind=6)), "PARAM_VALUE")
    assert reports.param_value == value
    assert rig.request_handler.intents == [SetParameter("FENCE_ENABLE", value)] * 2


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_read_only_parameter_is_refused_as_such(rig, of, texts, value):
    replies = rig.tell(set_to(b"STAT_BOOTCNT", value, kind=6))
    (error,) = of(replies, "PARAM_ERROR")
    assert (error.error, error.param_id) == (mavlink.MAV_PARAM_ERROR_READ_ONLY, "STAT_BOOTCNT")
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [0.0, 0.0]
    assert texts(replies) == ["STAT_BOOTCNT is read-only"]
    assert rig.request_handler.requests == []


def test_what_takes_effect_at_the_next_start_is_said_to(rig, of, texts):
    replies = rig.tell(set_to(b"LNK_SYSID", 7.0, kind=6))
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [7.0]
    assert texts(replies) == ["LNK_SYSID: takes effect at the next start"]
    assert texts(rig.tell(set_to(b"LNK_SYSID", 7.0, kind=6))) == []


def test_no_confirmation_is_lost_on_a_slow_line(make_rig, of):
    """More changes at once than the line's queue holds: each parameter is reported in the end, as it is then."""
    rig = make_rig(byte_rate=960.0, radio=True)
    rig.tick()
    reals = [row for row in TABLE if row.kind is Kind.REAL]
    replies = []
    for share in (0.25, 0.5, 0.75):
        for row in reals:
            replies += rig.tell(set_to(row.name.encode(), row.minimum + share * (row.maximum - row.minimum)))
    replies += rig.ticks(100)
    reports = {value.param_id: value.param_value for value in of(without_unasked(replies), "PARAM_VALUE")}
    assert reports == {row.name: rig.request_handler.values[row.name] for row in reals}


def test_a_line_that_takes_nothing_for_a_while_gets_what_it_is_owed(make_rig, of):
    rig = make_rig()
    rig.tick()
    rig.transport.is_writable = False
    for index in range(len(TABLE)):
        rig.transport.inbox.append(("station", rig.frame(mavlink.MAVLink_param_request_read_message(1, 1, b"", index))))
    for _ in range(20):
        rig.endpoint.service(rig.now_s, [100])
    rig.transport.is_writable = True
    rig.tick_silently()
    replies = rig.give(b"")
    assert [value.param_index for value in of(replies, "PARAM_VALUE")] == list(range(len(TABLE)))
    assert not rig.endpoint.busy


def test_two_stations_read_the_list_at_the_same_time(make_rig):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    for address in ("one", "two"):
        rig.transport.inbox.append((address, rig.frame(mavlink.MAVLink_param_request_list_message(1, 1))))
    rig.endpoint.service(rig.now_s, [100])
    while rig.endpoint.busy:
        rig.endpoint.service(rig.now_s, [])
    sent = list(rig.transport.sent)
    for address in ("one", "two"):
        rig.transport.sent = list(sent)
        assert [value.param_index for value in rig.replies(address)] == list(range(len(TABLE)))
