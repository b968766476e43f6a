"""The parameter protocols: PARAM and PARAM_EXT messages."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import SetParameter
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.link.files.payload import Opcode
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.urls import LinkClass, LinkOptions
from support.link import without_unrequested

UNKNOWN, OUT_OF_RANGE = 1, 2  # MAV_PARAM_ERROR
ACCEPTED, VALUE_UNSUPPORTED, FAILED = 0, 1, 2  # PARAM_ACK
K1 = INDEX["CTL_K1"]
LIST = mavlink.MAVLink_param_request_list_message(1, 1)
LIST_EXTENDED = mavlink.MAVLink_param_ext_request_list_message(1, 1)


def set_message(name, value, kind=Kind.REAL, target=(1, 1)):
    return mavlink.MAVLink_param_set_message(*target, name, value, kind)


def set_extended(name, value, kind=Kind.REAL):
    return mavlink.MAVLink_param_ext_set_message(1, 1, name, value, kind)


def read_message(name, index=-1):
    return mavlink.MAVLink_param_request_read_message(1, 1, name, index)


def read_extended(name, index=-1):
    return mavlink.MAVLink_param_ext_request_read_message(1, 1, name, index)


def extended_number(message):
    layout = {Kind.INTEGER: "<i", Kind.REAL: "<f"}[message.param_type]
    return struct.unpack_from(layout, message._param_value_raw.ljust(8, b"\0"))[0]


@pytest.fixture
def slow_rig(make_rig):
    """Makes a rig with a radio link of some bytes a second."""

    def make(byte_rate):
        rig = make_rig(byte_rate=byte_rate, has_radio_rates=True)
        rig.tick()
        return rig

    return make


# ---------------------------------------------------------------------- listing and reading


@pytest.mark.parametrize(
    ("request_message", "reply"),
    [
        (LIST, "PARAM_VALUE"),
        (mavlink.MAVLink_param_request_list_message(1, 0), "PARAM_VALUE"),
        (LIST_EXTENDED, "PARAM_EXT_VALUE"),
    ],
)
def test_list_has_all_parameters(rig, of, request_message, reply):
    values = of(rig.send(request_message) + rig.ticks(3), reply)
    assert [value.param_id for value in values] == [row.name for row in TABLE]
    assert [value.param_index for value in values] == list(range(len(TABLE)))
    assert {value.param_count for value in values} == {len(TABLE)}
    assert [value.param_type for value in values] == [row.kind for row in TABLE]
    numbers = [extended_number(value) if reply == "PARAM_EXT_VALUE" else value.param_value for value in values]
    assert numbers == list(rig.request_handler.values.values())


def test_generic_autopilot_has_only_floats(make_rig, of):
    rig = make_rig(identity=0)
    values = of(without_unrequested(rig.send(LIST) + rig.ticks(3)), "PARAM_VALUE")
    assert [value.param_value for value in values] == list(rig.request_handler.values.values())
    assert {value.param_type for value in values} == {Kind.REAL}
    for kind in Kind:
        (value,) = of(rig.send(set_message(b"LOOP_RATE_HZ", 10.0 + kind, kind)), "PARAM_VALUE")
        assert (value.param_value, value.param_type) == (10.0 + kind, Kind.REAL)


@pytest.mark.parametrize("read", [read_message, read_extended])
def test_parameter_is_read_by_name_and_by_index(rig, read):
    for message in (read(b"CTL_K1"), read(b"", K1)):
        (value,) = rig.send(message)
        number = extended_number(value) if read is read_extended else value.param_value
        assert (value.param_id, number, value.param_index) == ("CTL_K1", 40.0, K1)


@pytest.mark.parametrize("read", [read_message, read_extended])
@pytest.mark.parametrize(
    ("name", "index"), [(b"NOPE", -1), (b"", -1), (b"", 999), (b"", len(TABLE)), (b"CTL_K1", -2), (b"\xff" * 16, -1)]
)
def test_read_of_an_unknown_parameter_is_refused(rig, read, name, index):
    (error,) = rig.send(read(name, index))
    assert (error.get_type(), error.error, error.param_index) == ("PARAM_ERROR", UNKNOWN, index)


@pytest.mark.parametrize("end", [b"", b"\0"])
def test_name_of_sixteen_characters_needs_no_end(rig, monkeypatch, end):
    name = "A_NAME_OF_SIXTEEN"[:16]
    monkeypatch.setitem(INDEX, name, 3)
    (value,) = rig.send(read_message((name.encode() + end)[:16]))
    assert value.param_index == 3


# ---------------------------------------------------------------------- setting


def test_change_is_sent_to_all_peers(make_rig, of):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    rig.transport.inbox.append(("one", rig.frame(set_message(b"CTL_K1", 41.5))))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    sent = list(rig.transport.sent)
    for address in ("one", "two"):
        rig.transport.sent = list(sent)
        (value,) = of(rig.replies(address), "PARAM_VALUE")
        assert (value.param_id, value.param_value) == ("CTL_K1", 41.5)
    assert rig.request_handler.intents == [SetParameter("CTL_K1", 41.5)]


def test_change_by_satellite_is_sent_to_its_station_only(make_rig, of):
    rig = make_rig(addresses=("one", "two"), options=LinkOptions(link_class=LinkClass.SATELLITE))
    rig.tick()
    rig.transport.inbox.append(("one", rig.frame(set_message(b"CTL_K1", 41.5))))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    sent = list(rig.transport.sent)
    for address, values in (("one", [41.5]), ("two", [])):
        rig.transport.sent = list(sent)
        assert [value.param_value for value in of(rig.replies(address), "PARAM_VALUE")] == values


@pytest.mark.parametrize("is_stored", [True, False])
def test_change_is_confirmed_after_storing(rig, of, texts, is_stored):
    rig.request_handler.at_once = False
    assert rig.send(set_message(b"CTL_K1", 41.5)) == []
    rig.request_handler.waiting.pop()(is_stored)
    replies = rig.replies()
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [41.5] * is_stored
    assert texts(replies) == [] if is_stored else ["CTL_K1 active but not stored"]


# The types are MAV_PARAM_EXT_TYPE_UINT8 (1) to MAV_PARAM_EXT_TYPE_REAL64 (10).
@pytest.mark.parametrize(
    ("value", "kind"), [(struct.pack(f"<{layout}", 41), kind) for kind, layout in enumerate("BbHhIiQqfd", 1)]
)
@pytest.mark.parametrize(("is_stored", "result"), [(True, ACCEPTED), (False, FAILED)])
def test_extended_change_is_acknowledged_after_storing(rig, of, value, kind, is_stored, result):
    rig.request_handler.at_once = False
    assert rig.send(set_extended(b"CTL_K1", value, kind)) == []
    rig.request_handler.waiting.pop()(is_stored)
    replies = rig.replies()
    (ack,) = of(replies, "PARAM_EXT_ACK")
    assert (ack.param_id, ack.param_result) == ("CTL_K1", result)
    assert (extended_number(ack), ack.param_type) == (41.0, Kind.REAL)
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [41.0] * is_stored
    assert rig.request_handler.intents == [SetParameter("CTL_K1", 41.0)]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.4e38, -1.0, 200.5])
def test_invalid_value_is_refused_with_the_present_value_and_the_reason(rig, texts, of, value):
    replies = rig.send(set_message(b"CTL_K1", value))
    (error,) = of(replies, "PARAM_ERROR")
    assert (error.error, error.param_id, error.target_system) == (OUT_OF_RANGE, "CTL_K1", 255)
    # pymavlink takes the first reply for an acknowledgement and the second one for the present value.
    assert [present.param_value for present in of(replies, "PARAM_VALUE")] == [40.0, 40.0]
    assert "0 to 200" in texts(replies)[0]
    assert rig.request_handler.values["CTL_K1"] == 40.0


@pytest.mark.parametrize(
    ("name", "value", "kind", "result"),
    [
        (b"CTL_K1", struct.pack("<f", 1e30), Kind.REAL, VALUE_UNSUPPORTED),
        (b"CTL_K1", struct.pack("<f", float("nan")), Kind.REAL, VALUE_UNSUPPORTED),
        (b"LOOP_RATE_HZ", struct.pack("<f", 10.5), Kind.REAL, VALUE_UNSUPPORTED),
        (b"STAT_BOOTCNT", struct.pack("<i", 7), Kind.INTEGER, VALUE_UNSUPPORTED),
        (b"CTL_K1", b"forty", mavlink.MAV_PARAM_EXT_TYPE_CUSTOM, VALUE_UNSUPPORTED),
        (b"CTL_K1", b"\x29", 0, VALUE_UNSUPPORTED),  # 0 is not a MAV_PARAM_EXT_TYPE
        (b"NOPE", struct.pack("<f", 1.0), Kind.REAL, FAILED),
    ],
)
def test_invalid_extended_value_is_refused_with_the_present_value(rig, of, name, value, kind, result):
    values = rig.request_handler.values
    (ack,) = of(rig.send(set_extended(name, value, kind)), "PARAM_EXT_ACK")
    assert (ack.param_id, ack.param_result) == (name.decode(), result)
    if name != b"NOPE":
        assert extended_number(ack) == values[name.decode()]
    assert rig.request_handler.values is values


def test_integer_with_float_bytes_is_refused(rig, of):
    assert TABLE[INDEX["LOOP_RATE_HZ"]].kind is Kind.INTEGER
    assert of(rig.send(set_message(b"LOOP_RATE_HZ", 2.8e-44, kind=Kind.INTEGER)), "PARAM_ERROR")
    assert rig.request_handler.values["LOOP_RATE_HZ"] == 10


@pytest.mark.parametrize("target", [(2, 1), (1, 7)])
def test_change_for_another_system_or_component_is_ignored(rig, target):
    assert rig.send(set_message(b"CTL_K1", 41.5, target=target)) == []
    assert rig.request_handler.requests == []


def test_unknown_name_is_refused(rig):
    (error,) = rig.send(set_message(b"NOPE", 1.0))
    assert (error.error, error.param_id) == (UNKNOWN, "NOPE")
    assert rig.request_handler.requests == []


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_read_only_parameter_is_refused(rig, of, texts, value):
    replies = rig.send(set_message(b"STAT_BOOTCNT", value, kind=Kind.INTEGER))
    (error,) = of(replies, "PARAM_ERROR")
    assert (error.error, error.param_id) == (mavlink.MAV_PARAM_ERROR_READ_ONLY, "STAT_BOOTCNT")
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [0.0, 0.0]
    assert texts(replies) == ["STAT_BOOTCNT is read-only"]
    assert rig.request_handler.requests == []


def test_unchanged_value_is_confirmed_without_a_request(rig, of):
    rig.request_handler.at_once = False
    assert rig.send(set_message(b"CTL_K1", 40.0)) == []
    rig.request_handler.waiting.pop()(True)  # an earlier change to this value may not be stored yet
    (value,) = of(rig.replies(), "PARAM_VALUE")
    assert (value.param_id, value.param_value) == ("CTL_K1", 40.0)
    assert rig.request_handler.requests == []


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_fence_enable_is_requested_even_if_unchanged(rig, of, value):
    """A command may have overridden the parameter."""
    rig.send(set_message(b"FENCE_ENABLE", value, kind=Kind.INTEGER))
    (report,) = of(rig.send(set_message(b"FENCE_ENABLE", value, kind=Kind.INTEGER)), "PARAM_VALUE")
    assert report.param_value == value
    assert rig.request_handler.intents == [SetParameter("FENCE_ENABLE", value)] * 2


def test_parameter_that_needs_a_restart_is_reported(rig, of, texts):
    replies = rig.send(set_message(b"LNK_SYSID", 7.0, kind=Kind.INTEGER))
    assert [value.param_value for value in of(replies, "PARAM_VALUE")] == [7.0]
    assert texts(replies) == ["LNK_SYSID: takes effect at the next start"]
    assert texts(rig.send(set_message(b"LNK_SYSID", 7.0, kind=Kind.INTEGER))) == []


# ---------------------------------------------------------------------- limits


def test_number_of_unstored_changes_of_a_peer_is_limited_to_32(rig):
    rig.request_handler.at_once = False
    for number in range(100):
        rig.send(set_message(b"CTL_K1", 100.0 + number))
        rig.send(set_extended(b"CTL_K1", struct.pack("<f", number)))
    assert len(rig.request_handler.waiting) == 32
    pending, rig.request_handler.waiting = rig.request_handler.waiting, []
    for finish_storing in pending:
        finish_storing(True)
    rig.replies()
    rig.send(set_message(b"CTL_K1", 7.0))
    assert rig.request_handler.values["CTL_K1"] == 7.0


def test_unstored_changes_of_one_station_do_not_block_another(make_rig):
    rig = make_rig(addresses=("flooding", "normal"))
    rig.request_handler.at_once = False
    for number in range(200):
        rig.send(set_message(b"LOIT_RADIUS", 50.0 + number), address="flooding")
    pending_count = len(rig.request_handler.waiting)
    rig.send(set_message(b"RUD_LIMIT_DEG", 20.0), address="normal")
    assert len(rig.request_handler.waiting) == pending_count + 1
    assert rig.request_handler.values["RUD_LIMIT_DEG"] == 20.0


def test_number_of_unstored_changes_of_all_peers_is_limited_to_128(make_rig, ftp_station):
    addresses = [f"station {number}" for number in range(6)]
    rig = make_rig(addresses=["station", *addresses])
    rig.request_handler.at_once = False
    client = ftp_station(rig)
    client.ask(Opcode.CREATE, "@PARAM/param.pck")
    # The header of a parameter file: magic, number of parameters, length of the file.
    client.ask(Opcode.WRITE, struct.pack("<HHH", 0x671B, 0, 6))
    rig.send(client.request(Opcode.TERMINATE))
    assert len(rig.request_handler.waiting) == 1  # a file without a change
    for number in range(32):
        for address in addresses:
            rig.send(set_message(b"LOIT_RADIUS", 50.0 + number), address=address)
    assert len(rig.request_handler.waiting) == 128


# ---------------------------------------------------------------------- slow links


READ_ALL = [read_message(b"", row) for row in range(len(TABLE))]


@pytest.mark.parametrize(("byte_rate", "queued"), [(960.0, 8), (None, 64)])
@pytest.mark.parametrize("requests", [[LIST], READ_ALL])
def test_blocked_link_queues_few_parameters(make_rig, of, byte_rate, queued, requests):
    rig = make_rig(byte_rate=byte_rate)
    rig.tick()
    rig.transport.is_writable = False
    rig.transport.inbox += [("station", rig.frame(request)) for request in requests]
    for _ in range(20 + len(requests) // 4):
        rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    (peer,) = rig.endpoint._peers
    assert peer.outbox.queued_count(Priority.REPLY) == queued
    rig.transport.is_writable = True
    rig.tick_silently()
    assert rig.endpoint.busy is (byte_rate is None)  # a network continues before the next tick
    rig.replies()
    rig.endpoint.service(rig.now_s, [])
    assert len(of(rig.replies(), "PARAM_VALUE")) == (8 if byte_rate is None else 0)


@pytest.mark.parametrize(("name", "kind"), [(b"LNK_SYSID", Kind.INTEGER), (b"CTL_K1", Kind.REAL)])
def test_change_of_an_unproven_peer_is_sent_to_it_and_to_the_others(make_rig, of, name, kind):
    rig = make_rig()
    rig.tick()
    rig.request_handler.at_once = False
    assert rig.send(set_message(name, 7.0, kind), address="new") != []  # a heartbeat
    rig.request_handler.waiting.pop()(True)
    sent = list(rig.transport.sent)
    for address in ("station", "new"):
        rig.transport.sent = list(sent)
        assert [value.param_value for value in of(without_unrequested(rig.replies(address)), "PARAM_VALUE")] == [7.0]


@pytest.mark.parametrize(("byte_rate", "is_complete"), [(960.0, True), (120.0, False)])
def test_list_on_a_slow_link_does_not_delay_heartbeats(slow_rig, of, byte_rate, is_complete):
    rig = slow_rig(byte_rate)
    assert len(of(rig.send(LIST), "PARAM_VALUE")) < len(TABLE)
    replies = without_unrequested(rig.ticks(100))
    assert (of(replies, "PARAM_VALUE")[-1].param_index == len(TABLE) - 1) == is_complete
    assert len(of(replies, "HEARTBEAT")) == pytest.approx(10, abs=1)


def test_extended_list_on_a_slow_link_does_not_delay_telemetry(slow_rig, of):
    rig = slow_rig(1200.0)
    rig.send(LIST_EXTENDED)
    replies = without_unrequested(rig.ticks(50))
    # In 5 s, 70 % of 1200 bytes/s are for the list; a signed PARAM_EXT_VALUE frame has 174 bytes.
    assert len(of(replies, "PARAM_EXT_VALUE")) == pytest.approx(0.7 * 1200.0 * 5.0 / 174.0, abs=3)
    assert len(of(replies, "HEARTBEAT")) == pytest.approx(5, abs=1)
    assert len(of(replies, "ATTITUDE")) > 0
    replies += rig.ticks(250)
    assert [value.param_index for value in of(replies, "PARAM_EXT_VALUE")] == list(range(len(TABLE)))


def test_slow_link_sends_the_latest_value_of_every_change(slow_rig, of):
    """The changes exceed the queue of the link."""
    rig = slow_rig(960.0)
    reals = [row for row in TABLE if row.kind is Kind.REAL]
    replies = []
    for fraction in (0.25, 0.5, 0.75):
        for row in reals:
            replies += rig.send(set_message(row.name.encode(), row.minimum + fraction * (row.maximum - row.minimum)))
    replies += rig.ticks(100)
    reports = {value.param_id: value.param_value for value in of(without_unrequested(replies), "PARAM_VALUE")}
    assert reports == {row.name: rig.request_handler.values[row.name] for row in reals}


def test_blocked_link_gets_all_values_later(rig, of):
    rig.transport.is_writable = False
    for index in range(len(TABLE)):
        rig.transport.inbox.append(("station", rig.frame(read_message(b"", index))))
    for _ in range(20):
        rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    rig.transport.is_writable = True
    rig.tick_silently()
    assert [value.param_index for value in of(rig.give(b""), "PARAM_VALUE")] == list(range(len(TABLE)))
    assert not rig.endpoint.busy


def test_two_stations_read_the_list_at_the_same_time(make_rig):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    for address in ("one", "two"):
        rig.transport.inbox.append((address, rig.frame(LIST)))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    rig.finish()
    sent = list(rig.transport.sent)
    for address in ("one", "two"):
        rig.transport.sent = list(sent)
        assert [value.param_index for value in rig.replies(address)] == list(range(len(TABLE)))


@pytest.mark.parametrize(("request_message", "reply"), [(LIST, "PARAM_VALUE"), (LIST_EXTENDED, "PARAM_EXT_VALUE")])
def test_list_on_a_network_is_complete_before_the_next_tick_in_calls_of_8(rig, of, request_message, reply):
    rig.transport.inbox.append(("station", rig.frame(request_message)))
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    assert len(of(rig.replies(), reply)) == 8  # a call delays the tick
    count = 8
    rig.finish()
    count += len(of(rig.replies(), reply))
    assert count == len(TABLE)
