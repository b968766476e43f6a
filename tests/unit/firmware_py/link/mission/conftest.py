"""A ground station of the tests' own making that speaks the mission protocol with a rig."""

import msgspec
import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.reports import Home

PROTOCOL = (
    "MISSION_ACK",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_COUNT",
)
HOME = Home(0.6, 2.1, 3.5)


class PlanStation:
    """System 255, component 190, unless `sender` says otherwise."""

    def __init__(self, rig, *, home_count=1):
        self.rig = rig
        self.home_count = home_count

    def answers(self, *messages, **more):
        """Send messages and return what of the mission protocol was said."""
        return self.protocol(self.rig.tell(*messages, **more))

    @staticmethod
    def protocol(messages):
        return [message for message in messages if message.get_type() in PROTOCOL]

    @staticmethod
    def item(sequence, command=16, *, kind=0, frame=6, x=None, y=1_210_000_000, z=0.0, params=(0.0,) * 4, current=0):
        """A MISSION_ITEM_INT; by default a waypoint whose place reports its number."""
        x = 360_000_000 + sequence if x is None else x
        head = (1, 1, sequence, frame, command, current, 1)
        return mavlink.MAVLink_mission_item_int_message(*head, *params, x, y, z, kind)

    def mission(self, count, start=0):
        """Home and some waypoints."""
        return [self.item(sequence, x=360_000_000 + start + sequence) for sequence in range(self.home_count + count)]

    def count(self, number, kind=0):
        return self.answers(mavlink.MAVLink_mission_count_message(1, 1, number, kind))

    def upload(self, items, kind=0):
        """PlanUpload a plan as a station does, item by item as asked; return the MISSION_ACK."""
        replies = self.count(len(items), kind)
        while replies[-1].get_type() != "MISSION_ACK":
            (request,) = replies
            assert (request.get_type(), request.mission_type) == ("MISSION_REQUEST_INT", kind)
            assert (request.target_system, request.target_component) == (255, 190)
            replies = self.answers(items[request.seq])
        (ack,) = replies
        assert (ack.mission_type, ack.target_system, ack.target_component) == (kind, 255, 190)
        return ack

    def listed(self, kind=0):
        (count,) = self.answers(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        assert (count.get_type(), count.mission_type) == ("MISSION_COUNT", kind)
        return count

    def read(self, sequence, kind=0, *, whole=True):
        ask = mavlink.MAVLink_mission_request_int_message if whole else mavlink.MAVLink_mission_request_message
        (item,) = self.answers(ask(1, 1, sequence, kind))
        return item

    def download(self, kind=0, *, whole=True):
        """Download a plan; return the items."""
        items = [self.read(sequence, kind, whole=whole) for sequence in range(self.listed(kind).count)]
        for sequence, item in enumerate(items):
            assert item.get_type() == ("MISSION_ITEM_INT" if whole else "MISSION_ITEM")
            assert (item.seq, item.target_system, item.target_component, item.mission_type) == (
                sequence,
                255,
                190,
                kind,
            )
        self.rig.tell(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
        return items

    @staticmethod
    def fields(item):
        """All that an item says, to be compared."""
        numbers = (item.param1, item.param2, item.param3, item.param4, item.x, item.y, item.z)
        return item.frame, item.command, item.autocontinue, *map(repr, numbers)

    def all_fields(self, items):
        return [self.fields(item) for item in items]

    def places(self):
        """The latitudes of the mission in force, counted from 360000000."""
        return [item.x - 360_000_000 for item in self.rig.request_handler.plans().mission.items]


@pytest.fixture
def station(rig):
    rig.tick(home=HOME)
    return PlanStation(rig)


@pytest.fixture
def home():
    return HOME


@pytest.fixture
def make_station(make_rig):
    """Makes stations with rigs of other kinds; `identity` 0 is the generic autopilot, without home in missions."""

    def make(*, identity=3, **transport):
        rig = make_rig(identity=identity, **transport)
        rig.endpoint.service(0.0, [])
        rig.tick(home=HOME)
        return PlanStation(rig, home_count=int(identity == 3))

    return make


@pytest.fixture
def report():
    """Changes a mission report."""
    return msgspec.structs.replace
