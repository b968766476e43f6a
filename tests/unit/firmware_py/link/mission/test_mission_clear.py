"""Clearing of plans by the mission protocol."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.plan import PlanKind
from firmware_py.plans.items import Command
from firmware_py.plans.validation import PlanResult
from support.plan_station import acks, circle, clear_message, count_message, exchange_as_other, partial_message


@pytest.mark.parametrize(
    ("mission_type", "remaining", "name"),
    [
        (0, [1, 2], "Mission"),
        (1, [0, 2], "Fence"),
        (2, [0, 1], "Rally points"),
        (255, [], "Mission, fence and rally points"),
    ],
)
def test_clear_removes_the_plans_of_its_type(station, texts, mission_type, remaining, name):
    station.upload(station.mission(1))
    station.upload([circle(station)], 1)
    station.upload([station.item(0, Command.RALLY_POINT, kind=2)], 2)
    replies = station.rig.send(clear_message(mission_type))
    (ack,) = station.protocol(replies)
    assert (ack.type, ack.mission_type, ack.opaque_id) == (0, mission_type, 0)
    assert texts(replies) == [f"{name} cleared"]
    assert [int(kind) for kind in PlanKind if station.handler.plans().of(kind).items] == remaining


def test_repeated_clear_is_acknowledged_once(station):
    station.upload(station.mission(1))
    station.handler.at_once = False
    assert station.exchange(*[clear_message(255)] * 3) == []
    (finish_storing,) = station.handler.waiting
    finish_storing(True)
    assert acks(station.rig.replies()) == [0]
    # Empty plans are not stored again.
    assert acks(station.exchange(*[clear_message(255)] * 2)) == [0, 0]
    assert acks(station.count(0)) == [0]
    assert len(station.handler.intents) == 2


@pytest.mark.parametrize("other_type", [0, 255])
def test_simultaneous_clears_of_two_stations_are_both_acknowledged(station, other_type):
    station.upload(station.mission(1))
    station.upload([circle(station)], 1)
    station.handler.at_once = False
    assert station.exchange(clear_message()) == []
    assert exchange_as_other(station, clear_message(other_type)) == []
    for finish_storing in station.handler.waiting:
        finish_storing(True)
    replies = [(ack.target_system, ack.type, ack.mission_type) for ack in station.protocol(station.rig.replies())]
    assert sorted(replies) == sorted([(255, 0, 0), (254, 0, other_type)])
    assert bool(station.handler.plans().fence.items) is (other_type == 0)


def test_clear_that_cannot_be_stored_is_reported(station, texts):
    station.upload(station.mission(1))
    station.handler.plans_stored = False
    replies = station.rig.send(clear_message(255))
    assert acks(replies) == [PlanResult.ERROR]
    assert texts(replies) == ["Mission, fence and rally points not cleared: the disk is full"]
    assert station.places() == [1]


@pytest.mark.parametrize(
    "message",
    [
        count_message(2, 7),
        clear_message(7),
        mavlink.MAVLink_mission_request_list_message(1, 1, 7),
        mavlink.MAVLink_mission_request_int_message(1, 1, 0, 7),
        mavlink.MAVLink_mission_request_partial_list_message(1, 1, 0, 0, 7),
        partial_message(0, 0, 7),
    ],
)
def test_unknown_mission_type_is_refused(station, message):
    (ack,) = station.exchange(message)
    assert (ack.type, ack.mission_type) == (PlanResult.UNSUPPORTED, 7)
