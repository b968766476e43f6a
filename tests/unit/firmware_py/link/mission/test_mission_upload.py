"""Plans from a ground station: whole or not at all."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, ReplacePlan, Verdict
from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, Plans
from firmware_py.link.wire.urls import LinkClass, LinkOptions
from firmware_py.plans.validation import PlanResult

BY_SATELLITE = LinkOptions(link_class=LinkClass.SATELLITE)
OTHER = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)


def other_sends(station, message):
    """What a second ground station is answered."""
    return station.protocol(station.rig.give(message.pack(OTHER)))


@pytest.mark.parametrize("identity", [0, 3])
def test_a_mission_comes_whole_and_its_home_is_the_stations_own(make_station, identity):
    station = make_station(identity=identity)
    items = station.mission(3)
    ack = station.upload(items)
    assert (ack.type, ack.opaque_id) == (0, station.rig.request_handler.plans().mission.identity)
    assert station.places() == [station.home_count + index for index in range(3)]
    (intent,) = station.rig.request_handler.intents  # and home was not set
    assert isinstance(intent, ReplacePlan)


def test_all_fields_of_an_item_are_kept(station):
    item = station.item(1, 17, frame=3, x=-5, y=7, z=2.5, params=(1.5, math.nan, -20.0, 4.0))
    station.upload([station.item(0), item])
    assert repr(station.rig.request_handler.plans().mission.items) == repr(
        (PlanItem(17, 3, True, (1.5, math.nan, -20.0, 4.0), -5, 7, 2.5),)
    )


@pytest.mark.parametrize(("kind", "command"), [(1, 5003), (2, 5100)])
def test_fence_and_rally_points_have_no_home(station, kind, command):
    items = [station.item(sequence, command, kind=kind, params=(50.0, 0, 0, 0)) for sequence in range(3)]
    assert station.upload(items, kind).type == 0
    assert len(station.rig.request_handler.plans().of(PlanKind(kind)).items) == 3
    assert station.places() == []


def test_the_old_message_with_degrees_is_taken_too(station):
    station.count(2)
    old = mavlink.MAVLink_mission_item_message
    (request,) = station.answers(old(1, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0))
    assert request.get_type() == "MISSION_REQUEST"  # as the station seems to like it
    (ack,) = station.answers(old(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, 36.25, -121.5, 0))
    assert ack.type == 0
    (item,) = station.rig.request_handler.plans().mission.items
    assert (item.x, item.y) == (362_500_000, -1_215_000_000)


def test_coordinates_that_are_none_are_refused(station, texts):
    station.upload(station.mission(1))
    for x, y, result in ((math.nan, 0, 10), (0, math.inf, 11), (1e30, 0, 10), (214.8, 0, 10)):
        station.count(2)
        station.answers(station.item(0))
        replies = station.rig.tell(mavlink.MAVLink_mission_item_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, x, y, 0))
        assert station.protocol(replies)[0].type == result
    assert station.places() == [1]


@pytest.mark.parametrize("identity", [0, 3])
def test_an_empty_mission_clears_it(make_station, identity):
    station = make_station(identity=identity)
    station.upload(station.mission(2))
    ack = station.upload([])
    assert (ack.type, ack.opaque_id, station.places()) == (0, 0, [])


def test_home_alone_is_an_empty_mission_as_mavsdk_clears_one(station):
    station.upload(station.mission(2))
    assert station.upload([station.item(0, x=0, y=0, frame=0, current=1)]).type == 0
    assert station.places() == []
    # Whatever a station holds for home.
    assert station.upload([station.item(0, 0, x=2**31 - 1, z=math.nan, params=(math.nan,) * 4)]).type == 0


@pytest.mark.parametrize("count", [0, 2])
@pytest.mark.parametrize(("frame", "command"), [(6, 16), (3, 16), (0, 19)])
def test_a_waypoint_sent_for_home_is_reported_to_be_none(station, texts, frame, command, count):
    first = station.item(0, command, frame=frame)
    station.count(1 + count)
    replies = [message for item in (first, *station.mission(count)[1:]) for message in station.rig.tell(item)]
    assert [ack.type for ack in station.protocol(replies) if ack.get_type() == "MISSION_ACK"] == [0]
    assert texts(replies)[-1] == "First waypoint is taken as home and skipped"


@pytest.mark.parametrize(
    "first",
    [
        {"frame": 0},
        {"frame": 5, "x": 7},
        {"frame": 6, "x": 0, "y": 0},
        {"frame": 6, "x": 343_774_677 + 900, "y": 1_203_211_370 - 900},
        {"frame": 2, "x": 0, "y": 0, "command": 178},
    ],
)
def test_what_a_station_holds_for_home_is_reported_nothing_of(station, texts, first):
    station.count(3)
    replies = [
        message for item in (station.item(0, **first), *station.mission(2)[1:]) for message in station.rig.tell(item)
    ]
    assert texts(replies) == ["New mission: items 1 to 2"]


@pytest.mark.parametrize("identity", [0, 3])
def test_as_many_items_as_are_kept_and_not_one_more(make_station, identity):
    station = make_station(identity=identity)
    most = MAX_PLAN_ITEMS + station.home_count
    assert station.upload(station.mission(MAX_PLAN_ITEMS)).type == 0
    (ack,) = station.count(most + 1)
    assert ack.type == PlanResult.NO_SPACE
    assert len(station.places()) == MAX_PLAN_ITEMS


@pytest.mark.parametrize("identity", [0, 3])
def test_jumps_are_counted_from_the_first_item_of_the_plan(make_station, identity):
    station = make_station(identity=identity)
    jump = station.item(2 + station.home_count, 177, frame=2, params=(float(station.home_count), -1.0, 0, 0))
    assert station.upload([*station.mission(2), jump]).type == 0
    assert station.rig.request_handler.plans().mission.items[2].params == (0.0, -1.0, 0.0, 0.0)


def test_a_jump_to_home_is_refused(station, texts):
    jump = station.item(2, 177, frame=2, params=(0.0, 1.0, 0, 0))
    station.count(3)
    station.answers(*station.mission(1))
    replies = station.rig.tell(jump)
    assert [ack.type for ack in station.protocol(replies)] == [PlanResult.INVALID_PARAM1]
    assert texts(replies) == ["Mission rejected: item 2: DO_JUMP: param1 is home, which is no item to go on with"]


def test_a_bad_item_ends_the_upload_at_once_and_the_old_plan_stands(station, texts):
    station.upload(station.mission(2))
    station.count(4)
    station.answers(station.item(0))
    replies = station.rig.tell(station.item(1, 21))
    (ack,) = station.protocol(replies)
    assert (ack.type, ack.opaque_id) == (PlanResult.UNSUPPORTED, 0)
    assert texts(replies) == ["Mission rejected: item 1: command 21 is not known in a mission plan"]
    # The refusal is said again when its item comes again, and what comes late is left alone.
    (again,) = station.answers(station.item(1, 21))
    assert again.type == PlanResult.UNSUPPORTED
    assert station.answers(station.item(0)) == []
    assert station.places() == [1, 2]


def test_what_only_the_whole_shows_is_refused_too(station, texts):
    jump = station.item(1, 177, frame=2, params=(7.0, 1.0, 0, 0))
    station.count(2)
    station.answers(station.item(0))
    replies = station.rig.tell(jump)
    assert station.protocol(replies)[0].type == PlanResult.INVALID_PARAM1
    assert texts(replies) == ["Mission rejected: item 1: DO_JUMP: the target item does not exist"]


def test_duplicates_and_strangers_in_the_sequence_do_no_harm(station):
    items = station.mission(4)
    station.count(5)
    assert [request.seq for request in station.answers(items[0])] == [1]
    assert station.answers(items[0], items[3], items[0]) == []
    assert [request.seq for request in station.answers(items[1], items[1], items[2], items[4])] == [2, 3]
    assert [request.seq for request in station.answers(items[3])] == [4]
    (ack,) = station.answers(items[4])
    assert (ack.type, station.places()) == (0, [1, 2, 3, 4])


def test_a_lost_end_is_said_again_when_the_last_item_comes_again(station):
    items = station.mission(2)
    first = station.upload(items)
    (again,) = station.answers(items[2])
    assert (again.type, again.opaque_id) == (0, first.opaque_id)
    assert station.answers(items[1]) == []
    assert len(station.rig.request_handler.intents) == 1


def test_an_item_out_of_nowhere_is_not_wanted(station):
    (ack,) = station.answers(station.item(3))
    assert ack.type == PlanResult.ERROR


def test_what_does_not_come_is_asked_for_again_and_by_turns_in_the_old_way(station):
    station.count(3)
    query = station.protocol(station.rig.ticks(60))
    assert {request.seq for request in query} == {0}
    kinds = [request.get_type() for request in query]
    assert {"MISSION_REQUEST", "MISSION_REQUEST_INT"} == set(kinds)
    assert 4 <= len(query) <= 12
    (request,) = station.answers(station.item(0))
    assert request.seq == 1


def test_who_is_silent_for_long_is_reported_that_it_is_over(station, texts):
    station.upload(station.mission(1))
    station.count(4)
    replies = station.rig.ticks(170)
    ack = station.protocol(replies)[-1]
    assert (ack.get_type(), ack.type) == ("MISSION_ACK", PlanResult.OPERATION_CANCELLED)
    assert texts(replies)[-1] == "Mission rejected: station silent at item 0"
    assert station.protocol(station.rig.ticks(50)) == []
    assert station.places() == [1]


def test_a_quick_station_is_asked_again_sooner(station):
    items = station.mission(30)
    station.count(31)
    for item in items[:20]:
        station.answers(item)
        station.rig.now_s += 0.01
    assert len(station.protocol(station.rig.ticks(3))) >= 1


@pytest.mark.parametrize(
    "line",
    [
        {"byte_rate": 30.0, "datagrams": False},
        {"byte_rate": 1920.0, "datagrams": False, "options": BY_SATELLITE},
        {"options": BY_SATELLITE},  # over a network
    ],
)
def test_a_line_by_satellite_is_given_its_time(make_station, line):
    station = make_station(radio=True, **line)
    query = [len(station.count(2))]
    query += [len(station.protocol(station.rig.tick(seconds=10.0))) for _ in range(30)]
    assert (sum(query[:2]), query[2:12]) == (1, [0] * 10)
    assert sum(query) == 3
    assert [message.get_type() for message in station.answers(station.item(0))] != ["MISSION_ACK"]


RADIO = {"byte_rate": 5760.0, "radio": True, "datagrams": False}


@pytest.mark.parametrize(
    ("line", "trip_s", "in_vain"), [(RADIO, 1.0, 5), (RADIO, 3.0, 5), (RADIO, 6.0, 5), (RADIO, 12.0, 6), ({}, 6.0, 9)]
)
def test_on_a_slow_way_an_item_is_not_asked_for_while_its_answer_is_under_way(make_station, line, trip_s, in_vain):
    """A round trip longer than the first wait: each asking is answered, so that the first item comes several times."""
    station = make_station(**line)
    items, query, under_way = station.mission(20), [], []
    replies = station.count(len(items))
    while not replies or replies[-1].get_type() != "MISSION_ACK":
        query += [request.seq for request in replies]
        under_way += [(station.rig.now_s + trip_s, items[request.seq]) for request in replies]
        if under_way and under_way[0][0] <= station.rig.now_s:
            replies = station.answers(under_way.pop(0)[1])
        else:
            replies = station.protocol(station.rig.tick())
    assert set(query) == set(range(21))
    assert len(query) <= 21 + in_vain
    assert station.rig.now_s < 1.2 * 21 * trip_s + 5.0


@pytest.mark.parametrize(("line", "trip_s"), [(RADIO, 1.0), (RADIO, 4.0), ({}, 6.0)])
def test_what_is_lost_on_an_even_line_costs_half_a_round_trip_more(make_station, line, trip_s):
    station = make_station(**line)
    station.count(21)
    for item in station.mission(9):
        station.rig.ticks(round(trip_s / 0.1))
        station.answers(item, item)  # what was asked for in vain comes, too
    waited = [station.protocol(station.rig.tick()) for _ in range(round(1.5 * trip_s / 0.1))]
    assert [request.seq for replies in waited for request in replies] == [10]


def test_where_round_trips_are_long_silence_is_no_end(station):
    items = station.mission(9)
    station.count(len(items))
    for item in items[:3]:
        station.rig.ticks(60)
        station.answers(item, item)
    replies = station.protocol(station.rig.ticks(500))
    assert {message.get_type() for message in replies} == {"MISSION_REQUEST_INT"}  # which it has answered
    assert "MISSION_ACK" in [message.get_type() for message in station.protocol(station.rig.ticks(200))]


def test_what_a_lossy_line_doubles_makes_it_no_slower_for_long(make_station):
    station = make_station(byte_rate=5760.0, radio=True, datagrams=False)
    items = station.mission(20)
    station.count(len(items))
    station.rig.ticks(40)  # the first was lost
    for item in items[:15]:
        station.answers(item)
        station.answers(item)
        station.rig.ticks(2)
    assert len(station.protocol(station.rig.ticks(20))) >= 1


@pytest.mark.parametrize("baud", [1200, 9600, 57_600])
def test_over_a_radio_what_is_lost_is_asked_for_again_before_a_station_gives_up(make_station, baud):
    station = make_station(byte_rate=baud / 10.0, radio=True, datagrams=False)
    station.count(2)
    assert len(station.protocol(station.rig.ticks(50))) >= 2


def test_a_station_may_begin_again(station):
    station.count(3)
    station.answers(station.item(0), station.item(1))
    items = station.mission(3, start=100)
    assert station.upload(items).type == 0
    assert station.places() == [101, 102, 103]


@pytest.mark.parametrize("result", [15, 1])
def test_a_station_may_think_better_of_it(station, result):
    station.upload(station.mission(1))
    station.count(3)
    assert station.answers(mavlink.MAVLink_mission_ack_message(1, 1, result, 0)) == []
    assert station.protocol(station.rig.ticks(30)) == []
    assert station.places() == [1]


def test_a_count_that_the_line_has_doubled_begins_nothing(station):
    frame = station.rig.frame(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    items = station.mission(2)
    assert len(station.protocol(station.rig.give(frame))) == 1
    station.answers(items[0])
    assert station.protocol(station.rig.give(frame)) == []
    station.answers(items[1])
    assert [ack.type for ack in station.answers(items[2])] == [0]
    assert station.protocol(station.rig.give(frame)) == []
    station.rig.ticks(110)
    assert len(station.protocol(station.rig.give(frame))) == 1


@pytest.mark.parametrize("mission_type", [0, 255])
def test_a_clearing_that_the_line_has_doubled_touches_no_later_plan(station, mission_type):
    station.upload(station.mission(1))
    clearing = station.rig.frame(mavlink.MAVLink_mission_clear_all_message(1, 1, mission_type))
    assert [ack.type for ack in station.protocol(station.rig.give(clearing))] == [0]
    station.count(3)
    assert station.protocol(station.rig.give(clearing)) == []  # under way
    replies = [message for item in station.mission(2) for message in station.answers(item)]
    assert (replies[-1].get_type(), replies[-1].type) == ("MISSION_ACK", 0)
    assert station.protocol(station.rig.give(clearing)) == []  # and in force
    assert station.places() == [1, 2]
    # Asked again it comes with another number.
    assert [ack.type for ack in station.answers(mavlink.MAVLink_mission_clear_all_message(1, 1, mission_type))] == [0]
    assert station.places() == []


def test_a_second_station_waits_for_its_turn(station):
    station.count(3)
    station.answers(station.item(0))
    for message in (
        mavlink.MAVLink_mission_count_message(1, 1, 3, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 255),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 1, 0),
        station.item(1),
    ):
        (ack,) = other_sends(station, message)
        assert (ack.type, ack.target_system) == (PlanResult.DENIED, 254)
    # Its cancelling is not the other's, and other kinds are free.
    assert other_sends(station, mavlink.MAVLink_mission_ack_message(1, 1, 15, 0)) == []
    assert [m.get_type() for m in other_sends(station, mavlink.MAVLink_mission_count_message(1, 1, 1, 2))] == [
        "MISSION_REQUEST_INT"
    ]
    station.answers(station.item(1))
    (ack,) = station.answers(station.item(2))
    assert (ack.type, station.places()) == (0, [1, 2])


def test_a_second_station_takes_the_turn_of_one_that_fell_silent(station):
    station.count(3)
    station.rig.ticks(60)
    replies = other_sends(station, mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert [(message.get_type(), message.target_system) for message in replies] == [
        ("MISSION_ACK", 255),
        ("MISSION_REQUEST_INT", 254),
    ]
    assert replies[0].type == PlanResult.OPERATION_CANCELLED
    (late,) = station.answers(station.item(0))
    assert late.type == PlanResult.OPERATION_CANCELLED


def test_the_end_is_said_when_the_plan_is_on_disk(station):
    station.upload(station.mission(1))
    station.rig.request_handler.at_once = False
    items = station.mission(2, start=50)
    station.count(3)
    assert station.answers(items[0], items[1], items[2])[-1].get_type() == "MISSION_REQUEST_INT"
    assert station.answers(items[2]) == []
    assert station.protocol(station.rig.ticks(200)) == []
    assert station.places() == [1]
    (stored,) = station.rig.request_handler.waiting
    stored(True)
    (ack,) = station.protocol(station.rig.replies())
    assert (ack.type, station.places()) == (0, [51, 52])


def test_a_disk_that_fails_leaves_the_old_plan(station, texts):
    station.upload(station.mission(1))
    station.rig.request_handler.plans_stored = False
    station.count(1)
    replies = station.rig.tell(station.item(0))
    assert station.protocol(replies)[-1].type == PlanResult.ERROR
    assert texts(replies) == ["Mission rejected: the disk is full"]
    assert station.places() == [1]


def test_an_upload_begun_while_another_is_being_stored_gets_no_end_of_that(station):
    station.rig.request_handler.at_once = False
    items = station.mission(1)
    station.count(2)
    station.answers(*items)
    station.count(2)
    (stored,) = station.rig.request_handler.waiting
    stored(True)
    assert station.protocol(station.rig.replies()) == []
    assert station.places() == [1]


def test_a_refusal_of_the_loop_is_passed_on(station, texts):
    station.rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "not now")
    station.count(2)
    station.answers(station.item(0))
    replies = station.rig.tell(station.item(1))
    assert station.protocol(replies)[-1].type == PlanResult.ERROR
    assert texts(replies) == ["Mission rejected: not now"]


# ------------------------------------------------------------------------- parts of a plan


def write_part(station, first, last, kind=0):
    return station.answers(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind))


@pytest.mark.parametrize("identity", [0, 3])
def test_a_part_is_written_again(make_station, identity):
    station = make_station(identity=identity)
    station.upload(station.mission(4))
    home = station.home_count
    (request,) = write_part(station, 1 + home, 2 + home)
    assert request.seq == 1 + home
    station.answers(station.item(1 + home, x=360_000_900))
    (ack,) = station.answers(station.item(2 + home, x=360_000_901))
    assert (ack.type, ack.opaque_id) == (0, station.rig.request_handler.plans().mission.identity)
    assert station.places() == [home, 900, 901, 3 + home]


def test_home_and_an_end_beyond_the_last_item_are_taken_as_mavproxy_means_them(station):
    station.upload(station.mission(2))
    (request,) = write_part(station, 0, 3)
    assert [m.seq for m in station.answers(station.item(0), station.item(1, x=360_000_500))] == [1, 2]
    (ack,) = station.answers(station.item(2, x=360_000_501))
    assert (request.seq, ack.type, station.places()) == (0, 0, [500, 501])


@pytest.mark.parametrize(("first", "last"), [(-1, 1), (2, 1), (3, 3), (-32768, 32767)])
def test_parts_that_there_are_not(station, first, last):
    station.upload(station.mission(2))
    (ack,) = write_part(station, first, last)
    assert ack.type == PlanResult.INVALID_SEQUENCE
    assert station.places() == [1, 2]


def test_nothing_has_no_parts(station):
    assert write_part(station, 0, 0)[0].type == PlanResult.INVALID_SEQUENCE


def test_a_part_of_a_plan_that_has_gone_meanwhile_is_refused(station):
    station.upload(station.mission(2))
    write_part(station, 1, 1)
    kept = station.rig.request_handler
    kept.plans_kept = kept.plans_kept.replaced(type(kept.plans_kept.mission)(PlanKind.MISSION))
    (ack,) = station.answers(station.item(1))
    assert (ack.type, station.places()) == (PlanResult.ERROR, [])


# ----------------------------------------------------------------------------------- clear


@pytest.mark.parametrize(("published", "left"), [(0, [1, 2]), (1, [0, 2]), (2, [0, 1]), (255, [])])
def test_clearing(station, published, left):
    station.upload(station.mission(1))
    station.upload([station.item(0, 5003, kind=1, params=(5.0, 0, 0, 0))], 1)
    station.upload([station.item(0, 5100, kind=2)], 2)
    (ack,) = station.answers(mavlink.MAVLink_mission_clear_all_message(1, 1, published))
    assert (ack.type, ack.mission_type, ack.opaque_id) == (0, published, 0)
    assert [int(kind) for kind in PlanKind if station.rig.request_handler.plans().of(kind).items] == left


def test_clearing_again_and_again_is_one_clearing(station):
    station.upload(station.mission(1))
    clear = mavlink.MAVLink_mission_clear_all_message(1, 1, 255)
    station.rig.request_handler.at_once = False
    assert station.answers(clear, clear, clear) == []
    (stored,) = station.rig.request_handler.waiting
    stored(True)
    assert [ack.type for ack in station.protocol(station.rig.replies())] == [0]
    # And what is empty need not be stored.
    assert [ack.type for ack in station.answers(clear, clear)] == [0, 0]
    assert [ack.type for ack in station.count(0)] == [0]
    assert len(station.rig.request_handler.intents) == 2


@pytest.mark.parametrize("other", [0, 255])
def test_anyone_who_else_clears_meanwhile_has_an_answer_too_and_all_that_was_asked_is_cleared(station, other):
    station.upload(station.mission(1))
    station.upload([station.item(0, 5003, kind=1, params=(5.0, 0, 0, 0))], 1)
    station.rig.request_handler.at_once = False
    assert station.answers(mavlink.MAVLink_mission_clear_all_message(1, 1, 0)) == []
    assert other_sends(station, mavlink.MAVLink_mission_clear_all_message(1, 1, other)) == []
    for stored in station.rig.request_handler.waiting:
        stored(True)
    acks = [(ack.target_system, ack.type, ack.mission_type) for ack in station.protocol(station.rig.replies())]
    assert sorted(acks) == sorted([(255, 0, 0), (254, 0, other)])
    fence = station.rig.request_handler.plans().fence
    assert bool(fence.items) is (other == 0)


def test_clearing_what_cannot_be_stored(station, texts):
    station.upload(station.mission(1))
    station.rig.request_handler.plans_stored = False
    replies = station.rig.tell(mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    assert station.protocol(replies)[-1].type == PlanResult.ERROR
    assert texts(replies) == ["Mission, fence and rally points not cleared: the disk is full"]
    assert station.places() == [1]


@pytest.mark.parametrize(
    "make",
    [
        lambda kind: mavlink.MAVLink_mission_count_message(1, 1, 2, kind),
        lambda kind: mavlink.MAVLink_mission_clear_all_message(1, 1, kind),
        lambda kind: mavlink.MAVLink_mission_request_list_message(1, 1, kind),
        lambda kind: mavlink.MAVLink_mission_request_int_message(1, 1, 0, kind),
        lambda kind: mavlink.MAVLink_mission_request_partial_list_message(1, 1, 0, 0, kind),
        lambda kind: mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, kind),
    ],
)
def test_kinds_that_there_are_not(station, make):
    (ack,) = station.answers(make(7))
    assert (ack.type, ack.mission_type) == (PlanResult.UNSUPPORTED, 7)


# ---------------------------------------------------------------------- promises


@pytest.mark.parametrize(
    "refused",
    [
        mavlink.MAVLink_mission_count_message(1, 1, 2500, 0),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 3, 1, 0),
    ],
    ids=["too many items", "no such part"],
)
def test_a_refused_beginning_ends_the_upload_that_was_under_way(station, refused):
    station.upload(station.mission(2))
    station.count(4)
    station.answers(station.item(0), station.item(1))
    (ack,) = station.answers(refused)
    assert ack.type in (PlanResult.NO_SPACE, PlanResult.INVALID_SEQUENCE)
    assert station.protocol(station.rig.ticks(100)) == []
    other = station.mission(3, start=100)
    replies = station.answers(other[2], other[3])
    assert {message.type for message in replies} == {PlanResult.ERROR}
    assert station.places() == [1, 2]


def twin_sends(station, *messages):
    """What is answered to each of two stations with one number, when the second one speaks, by address."""
    transport = station.rig.transport
    transport.sent.clear()
    transport.inbox.append(("twin", b"".join(station.rig.frame(message) for message in messages)))
    station.rig.endpoint.service(station.rig.now_s, [transport.descriptor])
    sent = list(transport.sent)
    answers = {}
    for address in ("station", "twin"):
        transport.sent = list(sent)
        answers[address] = station.protocol(station.rig.replies(address))
    return answers


def test_two_stations_with_one_number_never_mix_their_plans(station):
    station.count(4)
    station.answers(station.item(0), station.item(1))
    others = station.mission(3, start=100)
    answers = twin_sends(station, mavlink.MAVLink_mission_count_message(1, 1, 4, 0), others[2], others[3])
    assert answers["station"] == []
    assert [ack.type for ack in answers["twin"]] == [PlanResult.DENIED] * 3
    assert twin_sends(station, mavlink.MAVLink_mission_ack_message(1, 1, 15, 0)) == {"station": [], "twin": []}
    replies = station.answers(station.item(2), station.item(3))
    assert [message.type for message in replies if message.get_type() == "MISSION_ACK"] == [0]
    assert station.places() == [1, 2, 3]
    # The end that is said again is said to who waits for it.
    (lost,) = twin_sends(station, station.item(3))["twin"]
    assert lost.type == PlanResult.ERROR


def test_two_stations_with_one_number_read_each_its_own(station):
    station.upload(station.mission(2))
    station.listed()
    kept = station.rig.request_handler
    kept.plans_kept = kept.plans_kept.replaced(Plan(PlanKind.MISSION))
    twin_sends(station, mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    assert station.read(2).get_type() == "MISSION_ITEM_INT"
    (twins,) = twin_sends(station, mavlink.MAVLink_mission_request_int_message(1, 1, 2, 0))["twin"]
    assert twins.type == PlanResult.INVALID_SEQUENCE


def test_who_comes_back_by_a_new_connection_need_not_wait_for_itself(station):
    station.rig.transport.datagrams = False
    station.rig.transport.served = ("first",)
    station.rig.tick()
    count = mavlink.MAVLink_mission_count_message(1, 1, 2, 0)
    station.rig.tell(count, address="first")
    station.rig.transport.served = ("again",)
    station.rig.tick()
    replies = station.protocol(station.rig.tell(count, address="again"))
    assert [message.get_type() for message in replies] == ["MISSION_REQUEST_INT"]


def a_fence(station, half=1_000):
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    places = [(360_000_000 + x * half, 1_210_000_000 + y * half) for x, y in corners]
    params = (4.0, 0.0, 0.0, 0.0)
    return [station.item(n, 5001, kind=1, frame=0, x=x, y=y, params=params) for n, (x, y) in enumerate(places)]


OUT = "Mission item 2 is 11 m outside the fence"


@pytest.mark.parametrize("identity", [0, 3])
def test_whichever_of_mission_and_fence_comes_last_what_lies_outside_is_reported(make_station, texts, identity):
    station = make_station(identity=identity)
    items = [*station.mission(1), station.item(station.home_count + 1, x=360_002_000)]
    out = OUT if identity else OUT.replace("2", "1", 1)
    station.upload(a_fence(station), 1)
    assert out not in texts(station.rig.ticks(3))
    for _ in range(2):  # the same again is reported again
        station.upload(items)
        assert texts(station.rig.ticks(3)).count(out) == 1
        assert out not in texts(station.rig.ticks(3))
    station.upload(a_fence(station, half=3_000), 1)
    assert not [text for text in texts(station.rig.ticks(3)) if "outside" in text]
    station.upload(a_fence(station), 1)
    assert texts(station.rig.ticks(3)).count(out) == 1


def test_several_items_outside_are_reported_in_one_text(station, texts):
    station.upload(a_fence(station), 1)
    station.upload([*station.mission(1), *(station.item(n, x=360_002_000) for n in range(2, 52))])
    assert texts(station.rig.ticks(5)) == [f"{OUT}, and 49 more"]


def test_a_large_fence_is_looked_at_a_little_in_each_tick(station, texts):
    """So that no tick is late for it: some 500 corners, or the whole fence once."""
    rig = station.rig
    corners = [PlanItem(5004, 0, True, (1.0, 0.0, 0.0, 0.0), 370_000_000 + n, 1_210_000_000) for n in range(999)]
    rig.request_handler.plans_kept = Plans(
        Plan.of(PlanKind.MISSION, [PlanItem(16, 3, x=360_002_000, y=1_210_000_000 + n) for n in range(20)]),
        Plan.of(PlanKind.FENCE, [*corners, PlanItem(5003, 0, True, (11.1, 0, 0, 0), 360_000_000, 1_210_000_000)]),
    )
    assert texts(rig.ticks(20)) == []
    assert texts(rig.ticks(30)) == ["Mission item 1 is 11 m outside the fence, and 19 more"]
