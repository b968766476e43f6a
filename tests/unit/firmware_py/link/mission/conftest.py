"""A ground station for tests that uses the mission protocol with a rig."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.reports import Home
from firmware_py.plans.items import Command

PROTOCOL = {f"MISSION_{name}" for name in ("ACK", "REQUEST", "REQUEST_INT", "ITEM", "ITEM_INT", "COUNT")}
HOME = Home(0.6, 2.1, 3.5)


class PlanStation:
    """Ground station with system 255, component 190."""

    def __init__(self, rig, *, home_count=1):
        self.rig = rig
        self.home_count = home_count

    @property
    def handler(self):
        return self.rig.request_handler

    def exchange(self, *messages, **options):
        """Send messages and return the replies of the mission protocol."""
        return self.protocol(self.rig.send(*messages, **options))

    @staticmethod
    def protocol(messages):
        return [message for message in messages if message.get_type() in PROTOCOL]

    def tick(self, **changes):
        return self.protocol(self.rig.tick(**changes))

    def ticks(self, count):
        return self.protocol(self.rig.ticks(count))

    @staticmethod
    def item(
        sequence,
        command=Command.WAYPOINT,
        *,
        kind=0,
        frame=6,
        x=None,
        y=1_210_000_000,
        z=0.0,
        params=(0.0,) * 4,
        current=0,
    ):
        """A MISSION_ITEM_INT; by default a waypoint whose latitude contains its number."""
        x = 360_000_000 + sequence if x is None else x
        header = (1, 1, sequence, frame, command, current, 1)
        return mavlink.MAVLink_mission_item_int_message(*header, *params, x, y, z, kind)

    def mission(self, count, start=0):
        """Home and some waypoints."""
        return [self.item(sequence, x=360_000_000 + start + sequence) for sequence in range(self.home_count + count)]

    def count(self, number, kind=0):
        return self.exchange(mavlink.MAVLink_mission_count_message(1, 1, number, kind))

    def upload(self, items, kind=0):
        """Upload a plan as a station does, item by item on request; return the MISSION_ACK."""
        replies = self.count(len(items), kind)
        while replies[-1].get_type() != "MISSION_ACK":
            (request,) = replies
            assert (request.get_type(), request.mission_type) == ("MISSION_REQUEST_INT", kind)
            assert (request.target_system, request.target_component) == (255, 190)
            replies = self.exchange(items[request.seq])
        (ack,) = replies
        assert (ack.mission_type, ack.target_system, ack.target_component) == (kind, 255, 190)
        return ack

    def request_list(self, kind=0):
        (count,) = self.exchange(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        assert (count.get_type(), count.mission_type) == ("MISSION_COUNT", kind)
        return count

    def read(self, sequence, kind=0, *, is_int=True):
        request = mavlink.MAVLink_mission_request_int_message if is_int else mavlink.MAVLink_mission_request_message
        (item,) = self.exchange(request(1, 1, sequence, kind))
        return item

    def download(self, kind=0, *, is_int=True):
        """Download a plan; return the items."""
        items = [self.read(sequence, kind, is_int=is_int) for sequence in range(self.request_list(kind).count)]
        for sequence, item in enumerate(items):
            assert item.get_type() == ("MISSION_ITEM_INT" if is_int else "MISSION_ITEM")
            assert (item.seq, item.mission_type) == (sequence, kind)
            assert (item.target_system, item.target_component) == (255, 190)
        self.rig.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
        return items

    @staticmethod
    def fields(item):
        """All fields of an item that belong to the plan; NaN is equal to NaN."""
        numbers = (item.param1, item.param2, item.param3, item.param4, item.x, item.y, item.z)
        return item.frame, item.command, item.autocontinue, *map(repr, numbers)

    def all_fields(self, items):
        return [self.fields(item) for item in items]

    def places(self):
        """The latitudes of the present mission, minus 360000000."""
        return [item.x - 360_000_000 for item in self.handler.plans().mission.items]


@pytest.fixture
def station(rig):
    rig.tick(home=HOME)
    return PlanStation(rig)


@pytest.fixture
def home():
    return HOME


@pytest.fixture
def make_station(make_rig):
    """Makes stations with other rigs; `identity` 0 is the generic autopilot, without home in missions."""

    def make(*, identity=3, **transport):
        rig = make_rig(identity=identity, **transport)
        rig.endpoint.service(0.0, [])
        rig.tick(home=HOME)
        return PlanStation(rig, home_count=int(identity == 3))

    return make
