"""Plans in one transfer: as MAVProxy packs them, whole and judged, or refused with the reason."""

import select
import struct
import threading

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind
from firmware_py.link.files.area import mavlink_crc32
from firmware_py.link.mission import plan_file
from firmware_py.link.mission.plan_file import unpack
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanProblem, PlanResult

TERMINATE, OPEN_READ, READ, CREATE, WRITE, CHECKSUM = 1, 4, 5, 6, 7, 14
MISSION = "@MISSION/mission.dat"


def content(items, kind=0, head=()):
    """A file of MISSION_ITEM_INT messages, as `wp ftpload` of MAVProxy writes it."""
    head = {"magic": 0x763D, "kind": kind, "options": 0, "first": 0, "count": len(items), **dict(head)}
    make = mavlink.MAVLink_mission_item_int_message
    rows = [make.unpacker.pack(*(getattr(item, name) for name in make.ordered_fieldnames)) for item in items]
    return struct.pack("<HHHHH", *head.values()) + b"".join(rows)


def read(whole):
    """The head and the items of a file, as `wp ftp` of MAVProxy reads it."""
    make = mavlink.MAVLink_mission_item_int_message
    size = make.unpacker.size
    rows = [make.unpacker.unpack_from(whole, at) for at in range(10, len(whole), size)]
    items = [make(**dict(zip(make.ordered_fieldnames, row, strict=True))) for row in rows]
    return struct.unpack_from("<HHHHH", whole), items


def test_a_mission_is_written_and_read_back(ftp_station, station, texts):
    rig, client = station.rig, ftp_station(station.rig)
    items = [*station.mission(3), station.item(4, Command.JUMP, frame=2, x=0, y=0, params=(2.0, 1.0, 0.0, 0.0))]
    assert client.put(MISSION, content(items)).ok
    plan = rig.request_handler.plans().of(PlanKind.MISSION)
    assert [item.x for item in plan.items] == [360_000_001, 360_000_002, 360_000_003, 0]
    assert plan.items[-1].params[0] == 1.0  # home is not counted in the plan
    head, back = read(client.get(MISSION))
    assert head == (0x763D, 0, 0, 0, 5)
    assert [(one.seq, one.command, one.x, one.param1) for one in back[1:]] == [
        (one.seq, one.command, one.x, one.param1) for one in items[1:]
    ]


def test_fences_and_rally_points_have_files_too(ftp_station, station):
    rig, client = station.rig, ftp_station(station.rig)
    circle = station.item(0, Command.INCLUDED_CIRCLE, kind=1, frame=0, params=(100.0, 0.0, 0.0, 0.0))
    assert client.put("@MISSION/fence.dat", content([circle], 1)).ok
    assert client.put("@MISSION/rally.dat", content([station.item(0, Command.RALLY_POINT, kind=2, frame=3)], 2)).ok
    assert [len(rig.request_handler.plans().of(kind).items) for kind in PlanKind] == [0, 1, 1]
    assert read(client.get("@MISSION/rally.dat"))[0] == (0x763D, 2, 0, 0, 1)
    assert client.put("@MISSION/fence.dat", content([], 1)).ok
    assert read(client.get("@MISSION/fence.dat")) == ((0x763D, 1, 0, 0, 0), [])


def test_what_is_refused_changes_nothing_and_says_why(ftp_station, station, texts):
    rig, client = station.rig, ftp_station(station.rig)
    assert client.put(MISSION, content(station.mission(3))).ok
    before = rig.request_handler.plans()
    items = station.mission(3)
    items[2] = station.item(2, command=9999)
    client.ask(CREATE, MISSION)
    client.ask(WRITE, content(items))
    replies = client.rig.tell(client.request(TERMINATE))
    assert any(text.startswith("@MISSION/mission.dat: item 2: ") for text in texts(replies))
    assert rig.request_handler.plans() == before


ONE = [mavlink.MAVLink_mission_item_int_message(0, 0, number, 6, 16, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0) for number in (0, 1)]


@pytest.mark.parametrize(
    ("whole", "complaint"),
    [
        (b"", "shorter"),
        (content(ONE, head={"magic": 1}), "begins with"),
        (content(ONE, 1), "of kind 1"),
        (content(ONE, head={"options": 1}), "whole plans"),
        (content(ONE, head={"first": 1}), "whole plans"),
        (content(ONE, head={"count": 3}), "do not hold 3"),
        (content(ONE)[:-1], "do not hold 2"),
        (content(ONE, head={"count": MAX_PLAN_ITEMS + 2}), "at most"),
        (content([ONE[0], ONE[0]]), "is numbered 0"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_file_that_is_none_is_refused(whole, complaint):
    fault = unpack(whole, PlanKind.MISSION, 1)
    assert isinstance(fault, PlanProblem)
    assert complaint in fault.text
    assert fault.result is not PlanResult.ACCEPTED


def test_without_home_the_first_item_counts():
    assert unpack(content(ONE), PlanKind.MISSION, 0) == Plan.of(PlanKind.MISSION, [PlanItem(16, 6, True, x=1, y=1)] * 2)


def test_the_loops_thread_neither_makes_nor_judges_a_plan(stored, station, monkeypatch):
    """2000 items take longer than a tick has to spare."""
    rig, client = stored(background=True)
    threads = []

    def noting(function):
        def noted(*arguments):
            threads.append(threading.current_thread() is threading.main_thread())
            return function(*arguments)

        return noted

    for name in ("pack", "unpack"):
        monkeypatch.setattr(plan_file, name, noting(getattr(plan_file, name)))

    def ask(*request, **fields):
        replies = client.all(*request, **fields)
        while not replies:  # until the worker is done
            assert select.select(rig.endpoint.descriptors()[-1:], [], [], 20.0)[0]
            rig.endpoint.service(rig.now_s, rig.endpoint.descriptors()[-1:])
            replies = client.replies(rig.replies())
        assert replies[0].ok, replies[0].error
        return replies[0]

    try:
        ask(CREATE, MISSION)
        whole = content(station.mission(2))
        ask(WRITE, whole)
        ask(TERMINATE)
        assert len(rig.request_handler.plans().of(PlanKind.MISSION).items) == 2
        checksum = ask(CHECKSUM, MISSION).data
        ask(OPEN_READ, MISSION)
        assert read(ask(READ, offset=0, size=239).data)[0] == (0x763D, 0, 0, 0, 3)
        assert int.from_bytes(checksum, "little") == mavlink_crc32(ask(READ, offset=0, size=239).data)
    finally:
        rig.endpoint.close()
    assert threads == [False] * 3
