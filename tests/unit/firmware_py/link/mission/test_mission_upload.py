"""Upload of plans by the mission protocol: complete or not at all."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, ReplacePlan, Verdict
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.link.wire.urls import LinkClass, LinkOptions
from firmware_py.plans.items import Command
from firmware_py.plans.validation import PlanResult
from support.plan_station import ack_message, acks, clear_message, count_message, exchange_as_other, partial_message

INVALID_X, INVALID_Y = PlanResult.INVALID_PARAM5_X, PlanResult.INVALID_PARAM6_Y
BY_SATELLITE = LinkOptions(link_class=LinkClass.SATELLITE)
RADIO = {"byte_rate": 5760.0, "has_radio_rates": True, "is_datagram": False}
BOTH_IDENTITIES = pytest.mark.parametrize("identity", [0, 3])


@BOTH_IDENTITIES
def test_upload_replaces_the_mission_and_does_not_set_home(make_station, identity):
    station = make_station(identity=identity)
    ack = station.upload(station.mission(3))
    assert (ack.type, ack.opaque_id) == (0, station.handler.plans().mission.identity)
    assert station.places() == [station.home_count + index for index in range(3)]
    (intent,) = station.handler.intents
    assert isinstance(intent, ReplacePlan)


def test_all_fields_of_an_item_are_stored(station):
    params = (1.5, math.nan, -20.0, 4.0)
    station.upload(
        [station.item(0), station.item(1, Command.LOITER_UNLIMITED, frame=3, x=-5, y=7, z=2.5, params=params)]
    )
    assert repr(station.handler.plans().mission.items) == repr(
        (PlanItem(int(Command.LOITER_UNLIMITED), 3, True, params, -5, 7, 2.5),)
    )


@pytest.mark.parametrize(("kind", "command"), [(1, Command.INCLUDED_CIRCLE), (2, Command.RALLY_POINT)])
def test_fence_and_rally_points_have_no_home(station, kind, command):
    items = [station.item(sequence, command, kind=kind, params=(50.0, 0, 0, 0)) for sequence in range(3)]
    assert station.upload(items, kind).type == 0
    assert len(station.handler.plans().of(PlanKind(kind)).items) == 3
    assert station.places() == []


def old_item(sequence, frame, x, y):
    return mavlink.MAVLink_mission_item_message(1, 1, sequence, frame, Command.WAYPOINT, 0, 1, 0, 0, 0, 0, x, y, 0)


def test_mission_item_with_degrees_is_accepted(station):
    station.count(2)
    (request,) = station.exchange(old_item(0, 0, 0, 0))
    assert request.get_type() == "MISSION_REQUEST"  # the form that the station uses
    assert acks(station.exchange(old_item(1, 3, 36.25, -121.5))) == [0]
    (item,) = station.handler.plans().mission.items
    assert (item.x, item.y) == (362_500_000, -1_215_000_000)


@pytest.mark.parametrize(
    ("x", "y", "result"),
    [(math.nan, 0, INVALID_X), (0, math.inf, INVALID_Y), (1e30, 0, INVALID_X), (214.8, 0, INVALID_X)],
)
def test_coordinate_out_of_range_is_refused(station, x, y, result):
    station.upload(station.mission(1))
    station.count(2)
    station.exchange(station.item(0))
    assert acks(station.exchange(old_item(1, 3, x, y))) == [result]
    assert station.places() == [1]


@BOTH_IDENTITIES
def test_empty_mission_clears_the_mission(make_station, identity):
    station = make_station(identity=identity)
    station.upload(station.mission(2))
    ack = station.upload([])
    assert (ack.type, ack.opaque_id, station.places()) == (0, 0, [])


def test_home_alone_is_an_empty_mission(station):
    """MAVSDK clears a mission in this way."""
    station.upload(station.mission(2))
    assert station.upload([station.item(0, x=0, y=0, frame=0, current=1)]).type == 0
    assert station.places() == []
    # Item 0 is not validated.
    item = station.item(0, 0, x=2**31 - 1, z=math.nan, params=(math.nan,) * 4)
    assert station.upload([item]).type == 0
    assert acks(station.exchange(item)) == [0]  # repeated


@pytest.mark.parametrize(
    ("item_0", "count", "text"),
    [
        *(
            ({"frame": frame, "command": command}, count, "First waypoint is taken as home and skipped")
            for frame, command in ((6, Command.WAYPOINT), (3, Command.WAYPOINT), (0, Command.LOITER_TIME))
            for count in (0, 2)
        ),
        *(({"x": x, "y": y}, 2, "First waypoint is taken as home and skipped") for x, y in ((0, 7), (7, 0))),
        ({"x": 343_774_677 + 1001, "y": 1_203_211_370}, 2, "First waypoint is taken as home and skipped"),
        ({"x": 343_774_677 + 1000, "y": 1_203_211_370 - 1000}, 2, "New mission: items 1 to 2"),
        *(
            (item_0, 2, "New mission: items 1 to 2")
            for item_0 in (
                {"frame": 0},
                {"frame": 5, "x": 7},
                {"frame": 6, "x": 0, "y": 0},
                {"frame": 2, "x": 0, "y": 0, "command": Command.CHANGE_SPEED},
            )
        ),
    ],
)
def test_waypoint_as_item_0_is_reported_and_home_is_not(station, texts, item_0, count, text):
    station.count(1 + count)
    items = (station.item(0, **item_0), *station.mission(count)[1:])
    replies = [message for item in items for message in station.rig.send(item)]
    assert acks(replies) == [0]
    assert texts(replies)[-1] == text


@BOTH_IDENTITIES
def test_number_of_items_is_limited(make_station, identity):
    station = make_station(identity=identity)
    assert station.upload(station.mission(2000)).type == 0
    assert acks(station.count(2001 + station.home_count)) == [PlanResult.NO_SPACE]
    assert len(station.places()) == 2000


@BOTH_IDENTITIES
def test_jump_targets_are_stored_without_home(make_station, identity):
    station = make_station(identity=identity)
    jump = station.item(2 + station.home_count, Command.JUMP, frame=2, params=(float(station.home_count), -1.0, 0, 0))
    assert station.upload([*station.mission(2), jump]).type == 0
    assert station.handler.plans().mission.items[2].params == (0.0, -1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("fields", "result", "reason"),
    [
        ({"command": 21}, PlanResult.UNSUPPORTED, "command 21 is not known"),
        (
            {"command": Command.JUMP, "frame": 2, "params": (0.0, 1.0, 0, 0)},
            PlanResult.INVALID_PARAM1,
            "param1 is home",
        ),
        (
            {"command": Command.JUMP, "frame": 2, "params": (7.0, 1.0, 0, 0)},
            PlanResult.INVALID_PARAM1,
            "does not exist",
        ),
    ],
    ids=["unknown command", "jump to home", "jump beyond the end"],
)
def test_invalid_item_ends_the_upload_and_keeps_the_old_plan(station, texts, fields, result, reason):
    station.upload(station.mission(2))
    station.count(3)
    station.exchange(*station.mission(1))
    replies = station.rig.send(station.item(2, **fields))
    (ack,) = station.protocol(replies)
    assert (ack.type, ack.opaque_id) == (result, 0)
    (text,) = texts(replies)
    assert text.startswith("Mission rejected: item 2: ")
    assert reason in text
    # The refusal is repeated for the last item; a late earlier item gets no reply.
    (repeated,) = station.exchange(station.item(2, **fields))
    assert (repeated.type, repeated.opaque_id) == (result, 0)
    assert station.exchange(station.item(0)) == []
    assert station.places() == [1, 2]


def test_duplicate_and_early_items_are_ignored(station):
    items = station.mission(4)
    station.count(5)
    assert [request.seq for request in station.exchange(items[0])] == [1]
    assert station.exchange(items[0], items[3], items[0]) == []
    assert [request.seq for request in station.exchange(items[1], items[1], items[2], items[4])] == [2, 3]
    assert [request.seq for request in station.exchange(items[3])] == [4]
    assert acks(station.exchange(items[4])) == [0]
    assert station.places() == [1, 2, 3, 4]


def test_acknowledgement_is_repeated_for_the_last_item(station):
    items = station.mission(2)
    ack = station.upload(items)
    (repeated,) = station.exchange(items[2])
    assert (repeated.type, repeated.opaque_id) == (0, ack.opaque_id)
    station.rig.now_s += 1.5
    assert station.exchange(items[1]) == []
    station.rig.now_s += 0.01  # later than any duplicate
    (repeated,) = station.exchange(items[1])
    assert (repeated.type, repeated.opaque_id) == (0, ack.opaque_id)
    assert len(station.handler.intents) == 1


@pytest.mark.parametrize(("later_stations", "result"), [(7, PlanResult.ACCEPTED), (8, PlanResult.ERROR)])
def test_results_of_eight_uploads_are_stored(station, later_stations, result):
    items = station.mission(1)
    station.upload(items)
    rig, system = station.rig, station.rig.station.srcSystem
    for number in range(later_stations):
        rig.station.srcSystem = 100 + number
        assert acks([*station.count(2), *station.exchange(*items)]) == [PlanResult.ACCEPTED]
    rig.station.srcSystem = system
    assert acks(station.exchange(items[1])) == [result]


# ---------------------------------------------------------------------- repeated requests and timeouts


def test_missing_item_is_requested_again_in_both_forms(station):
    station.count(3)
    requests = station.ticks(60)
    assert {request.seq for request in requests} == {0}
    forms = [request.get_type().removeprefix("MISSION_") for request in requests]
    assert forms == ["REQUEST_INT", "REQUEST", "REQUEST", "REQUEST_INT", "REQUEST_INT"]
    (request,) = station.exchange(station.item(0))
    assert request.seq == 1


def test_upload_of_a_silent_station_ends_and_is_reported(station, texts):
    station.upload(station.mission(1))
    station.count(4)
    assert acks(station.tick(seconds=14.9)) == []
    station.count(4)
    replies = station.rig.tick(seconds=15.0)
    assert acks(station.protocol(replies)[-1:]) == [PlanResult.OPERATION_CANCELLED]
    assert texts(replies)[-1] == "Mission rejected: station silent at item 0"
    assert station.ticks(50) == []
    assert station.places() == [1]


def test_request_is_repeated_sooner_to_a_fast_station(station):
    station.count(31)
    for item in station.mission(30)[:20]:
        station.exchange(item)
        station.rig.now_s += 0.01
    assert len(station.ticks(3)) >= 1


@pytest.mark.parametrize(
    "link",
    [
        {"byte_rate": 30.0, "is_datagram": False},
        {"byte_rate": 1920.0, "is_datagram": False, "options": BY_SATELLITE},
        {"options": BY_SATELLITE},
    ],
    ids=["slow line", "satellite line", "satellite network"],
)
def test_requests_by_satellite_have_long_intervals(make_station, link):
    station = make_station(has_radio_rates=True, **link)
    requests = [len(station.count(2)), *(len(station.tick(seconds=10.0)) for _ in range(30))]
    assert (sum(requests[:2]), requests[2:12]) == (1, [0] * 10)
    assert sum(requests) == 3
    assert [message.get_type() for message in station.exchange(station.item(0))] != ["MISSION_ACK"]


@pytest.mark.parametrize(
    ("link", "round_trip_s", "max_repeats"),
    [(RADIO, 1.0, 5), (RADIO, 3.0, 5), (RADIO, 6.0, 5), (RADIO, 12.0, 6), ({}, 6.0, 9)],
)
def test_requests_are_not_repeated_within_a_long_round_trip(make_station, link, round_trip_s, max_repeats):
    """The round trip is longer than the first interval, so the first item is requested and sent several times."""
    station = make_station(**link)
    items, requested, in_transit = station.mission(20), [], []
    replies = station.count(len(items))
    while not replies or replies[-1].get_type() != "MISSION_ACK":
        requested += [request.seq for request in replies]
        in_transit += [(station.rig.now_s + round_trip_s, items[request.seq]) for request in replies]
        has_arrived = in_transit and in_transit[0][0] <= station.rig.now_s
        replies = station.exchange(in_transit.pop(0)[1]) if has_arrived else station.tick()
    assert set(requested) == set(range(21))
    assert len(requested) <= 21 + max_repeats
    assert station.rig.now_s < 1.2 * 21 * round_trip_s + 5.0


@pytest.mark.parametrize(("link", "round_trip_s"), [(RADIO, 1.0), (RADIO, 4.0), ({}, 6.0)])
def test_lost_item_is_requested_again_within_one_and_a_half_round_trips(make_station, link, round_trip_s):
    station = make_station(**link)
    station.count(21)
    for item in station.mission(9):
        station.rig.ticks(round(round_trip_s / 0.1))
        station.exchange(item, item)  # the second is the reply to a repeated request
    assert [request.seq for request in station.ticks(round(1.5 * round_trip_s / 0.1))] == [10]


def test_long_round_trips_extend_the_timeout(station):
    items = station.mission(9)
    station.count(len(items))
    for item in items[:3]:
        station.rig.ticks(60)
        station.exchange(item, item)
    assert {message.get_type() for message in station.ticks(500)} == {"MISSION_REQUEST_INT"}
    assert acks(station.ticks(200))


def test_duplicates_by_the_link_do_not_extend_the_interval(make_station):
    station = make_station(**RADIO)
    items = station.mission(20)
    station.count(len(items))
    station.rig.ticks(40)  # the first item is lost
    for item in items[:15]:
        station.exchange(item)
        station.exchange(item)
        station.rig.ticks(2)
    assert len(station.ticks(20)) >= 1


@pytest.mark.parametrize("baud", [1200, 9600, 57_600])
def test_request_by_radio_is_repeated_within_five_seconds(make_station, baud):
    """Ground stations end an upload after about five seconds."""
    station = make_station(byte_rate=baud / 10.0, has_radio_rates=True, is_datagram=False)
    station.count(2)
    assert len(station.ticks(50)) >= 2


# ---------------------------------------------------------------------- restarts, duplicates and other stations


def test_station_restarts_its_upload(station):
    station.count(3)
    station.exchange(station.item(0), station.item(1))
    assert station.upload(station.mission(3, start=100)).type == 0
    assert station.places() == [101, 102, 103]


@pytest.mark.parametrize("result", [PlanResult.OPERATION_CANCELLED, PlanResult.ERROR])
def test_station_cancels_its_upload(station, result):
    station.upload(station.mission(1))
    station.count(3)
    assert station.exchange(ack_message(result)) == []
    assert station.ticks(30) == []
    assert station.places() == [1]


def test_duplicate_count_does_not_restart_the_upload(station):
    frame = station.rig.frame(count_message(3))
    items = station.mission(2)
    assert len(station.protocol(station.rig.give(frame))) == 1
    station.exchange(items[0])
    assert station.protocol(station.rig.give(frame)) == []
    station.exchange(items[1])
    assert acks(station.exchange(items[2])) == [0]
    assert station.protocol(station.rig.give(frame)) == []
    station.rig.now_s += 9.9
    assert station.protocol(station.rig.give(frame)) == []
    station.rig.now_s += 0.11
    assert len(station.protocol(station.rig.give(frame))) == 1


@pytest.mark.parametrize("mission_type", [0, 255])
def test_duplicate_clear_does_not_clear_a_later_plan(station, mission_type):
    station.upload(station.mission(1))
    frame = station.rig.frame(clear_message(mission_type))
    assert acks(station.rig.give(frame)) == [0]
    station.count(3)
    assert station.protocol(station.rig.give(frame)) == []  # during the upload
    assert acks(message for item in station.mission(2) for message in station.exchange(item)) == [0]
    assert station.protocol(station.rig.give(frame)) == []  # after the upload
    assert station.places() == [1, 2]
    # A repeated request has another frame number.
    assert acks(station.exchange(clear_message(mission_type))) == [0]
    assert station.places() == []


def test_second_station_is_refused_during_an_upload(station):
    station.count(3)
    station.exchange(station.item(0))
    for message in (count_message(3), clear_message(), clear_message(255), partial_message(0, 1), station.item(1)):
        (ack,) = exchange_as_other(station, message)
        assert (ack.type, ack.target_system) == (PlanResult.DENIED, 254)
    assert exchange_as_other(station, ack_message(PlanResult.OPERATION_CANCELLED)) == []  # it cannot cancel
    (request,) = exchange_as_other(station, count_message(1, 2))  # other plan types are free
    assert request.get_type() == "MISSION_REQUEST_INT"
    station.exchange(station.item(1))
    assert acks(station.exchange(station.item(2))) == [0]
    assert station.places() == [1, 2]


def test_second_station_replaces_the_upload_of_a_silent_one(station):
    station.count(3)
    start_s = station.rig.now_s
    station.rig.now_s = start_s + 4.9
    assert acks(exchange_as_other(station, count_message(3))) == [PlanResult.DENIED]
    station.rig.now_s = start_s + 5.0
    ack, request = exchange_as_other(station, count_message(2))
    assert (ack.get_type(), ack.target_system, ack.type) == ("MISSION_ACK", 255, PlanResult.OPERATION_CANCELLED)
    assert (request.get_type(), request.target_system) == ("MISSION_REQUEST_INT", 254)
    assert acks(station.exchange(station.item(0))) == [PlanResult.OPERATION_CANCELLED]


def test_station_with_a_new_connection_restarts_its_upload_at_once(station):
    station.rig.transport.is_datagram = False
    for address in ("first", "second"):
        station.rig.transport.served = (address,)
        station.rig.tick()
        replies = station.exchange(count_message(2), address=address)
    assert [message.get_type() for message in replies] == ["MISSION_REQUEST_INT"]


@pytest.mark.parametrize(
    ("message", "result"),
    [(count_message(2500), PlanResult.NO_SPACE), (partial_message(3, 1), PlanResult.INVALID_SEQUENCE)],
    ids=["too many items", "no such part"],
)
def test_refused_request_ends_the_former_upload(station, message, result):
    station.upload(station.mission(2))
    station.count(4)
    station.exchange(station.item(0), station.item(1))
    assert acks(station.exchange(message)) == [result]
    assert station.ticks(100) == []
    items = station.mission(3, start=100)
    assert set(acks(station.exchange(items[2], items[3]))) == {PlanResult.ERROR}
    assert station.places() == [1, 2]


def exchange_as_duplicate(station, *messages):
    """Send messages from a second station with the same system id; return the replies to each station by address."""
    transport = station.rig.transport
    transport.sent.clear()
    transport.inbox.append(("duplicate", b"".join(station.rig.frame(message) for message in messages)))
    station.rig.endpoint.service(station.rig.now_s, [transport.descriptor])
    sent = list(transport.sent)
    replies = {}
    for address in ("station", "duplicate"):
        transport.sent = list(sent)
        replies[address] = station.protocol(station.rig.replies(address))
    return replies


def test_two_stations_with_one_system_id_do_not_mix_their_uploads(station):
    station.count(4)
    station.exchange(station.item(0), station.item(1))
    items = station.mission(3, start=100)
    replies = exchange_as_duplicate(station, count_message(4), items[2], items[3])
    assert replies["station"] == []
    assert acks(replies["duplicate"]) == [PlanResult.DENIED] * 3
    assert exchange_as_duplicate(station, ack_message(PlanResult.OPERATION_CANCELLED)) == {
        "station": [],
        "duplicate": [],
    }
    assert acks(station.exchange(station.item(2), station.item(3))) == [0]
    assert station.places() == [1, 2, 3]
    # The acknowledgement is repeated only to the station that has uploaded.
    assert acks(exchange_as_duplicate(station, station.item(3))["duplicate"]) == [PlanResult.ERROR]


def test_two_stations_with_one_system_id_have_separate_downloads(station):
    station.upload(station.mission(2))
    station.request_list()
    station.handler.stored_plans = station.handler.stored_plans.replaced(Plan(PlanKind.MISSION))
    exchange_as_duplicate(station, ack_message(0))
    assert station.read(2).get_type() == "MISSION_ITEM_INT"
    request = mavlink.MAVLink_mission_request_int_message(1, 1, 2, 0)
    assert acks(exchange_as_duplicate(station, request)["duplicate"]) == [PlanResult.INVALID_SEQUENCE]


# ---------------------------------------------------------------------- storing


def test_acknowledgement_is_sent_after_storing(station):
    station.upload(station.mission(1))
    station.handler.at_once = False
    items = station.mission(2, start=50)
    station.count(3)
    assert acks(station.exchange(*items)) == []
    assert station.exchange(items[2]) == []
    assert station.ticks(200) == []
    assert station.places() == [1]
    (finish_storing,) = station.handler.waiting
    finish_storing(True)
    assert acks(station.rig.replies()) == [0]
    assert station.places() == [51, 52]


def test_upload_that_begins_during_storing_gets_no_result_of_the_former(station):
    station.handler.at_once = False
    station.count(2)
    station.exchange(*station.mission(1))
    station.count(2)
    (finish_storing,) = station.handler.waiting
    finish_storing(True)
    assert station.protocol(station.rig.replies()) == []
    assert station.places() == [1]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"plans_stored": False}, "the disk is full"),
        ({"answer": Answer(Verdict.TEMPORARILY_REJECTED, "not now")}, "not now"),
        ({"answer": Answer(Verdict.TEMPORARILY_REJECTED)}, "it was refused"),
    ],
)
def test_refused_plan_keeps_the_old_one_and_gives_the_reason(station, texts, changes, reason):
    station.upload(station.mission(1))
    for name, value in changes.items():
        setattr(station.handler, name, value)
    station.count(2)
    station.exchange(station.item(0))
    replies = station.rig.send(station.item(1, x=360_000_007))
    assert acks(replies) == [PlanResult.ERROR]
    assert texts(replies) == [f"Mission rejected: {reason}"]
    assert station.places() == [1]


# ---------------------------------------------------------------------- partial uploads


@BOTH_IDENTITIES
def test_part_of_a_plan_is_replaced(make_station, identity):
    station = make_station(identity=identity)
    station.upload(station.mission(4))
    home = station.home_count
    (request,) = station.exchange(partial_message(1 + home, 2 + home))
    assert request.seq == 1 + home
    station.exchange(station.item(1 + home, x=360_000_900))
    (ack,) = station.exchange(station.item(2 + home, x=360_000_901))
    assert (ack.type, ack.opaque_id) == (0, station.handler.plans().mission.identity)
    assert station.places() == [home, 900, 901, 3 + home]


def test_partial_upload_includes_home_and_limits_the_end(station):
    """MAVProxy sends such requests."""
    station.upload(station.mission(2))
    (request,) = station.exchange(partial_message(0, 3))
    assert request.seq == 0
    requests = station.exchange(station.item(0), station.item(1, x=360_000_500))
    assert [request.seq for request in requests] == [1, 2]
    assert acks(station.exchange(station.item(2, x=360_000_501))) == [0]
    assert station.places() == [500, 501]


@pytest.mark.parametrize(
    ("count", "first", "last"), [(2, -1, 1), (2, 2, 1), (2, 3, 3), (2, -32768, 32767), (None, 0, 0)]
)
def test_partial_upload_of_items_that_do_not_exist_is_refused(station, count, first, last):
    if count is not None:
        station.upload(station.mission(count))
    assert acks(station.exchange(partial_message(first, last))) == [PlanResult.INVALID_SEQUENCE]
    assert station.places() == ([] if count is None else [1, 2])


def test_partial_upload_is_refused_if_the_plan_has_changed(station):
    station.upload(station.mission(2))
    station.exchange(partial_message(1, 1))
    station.handler.stored_plans = station.handler.stored_plans.replaced(Plan(PlanKind.MISSION))
    assert acks(station.exchange(station.item(1))) == [PlanResult.ERROR]
    assert station.places() == []
