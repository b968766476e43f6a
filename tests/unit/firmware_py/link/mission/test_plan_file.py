"""Plans by file transfer, in the format of MAVProxy."""

import select
import struct
import threading

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Verdict
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.link.files.area import mavlink_crc32
from firmware_py.link.files.payload import Opcode
from firmware_py.link.mission import plan_file
from firmware_py.link.mission.items import new_plan_text
from firmware_py.link.mission.plan_file import unpack
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanProblem, PlanResult

MISSION = "@MISSION/mission.dat"
ITEM = mavlink.MAVLink_mission_item_int_message


def encode(items, kind=0, **header):
    """A file of MISSION_ITEM_INT messages, as `wp ftpload` of MAVProxy writes it."""
    header = {"magic": 0x763D, "kind": kind, "options": 0, "first": 0, "count": len(items), **header}
    rows = [ITEM.unpacker.pack(*(getattr(item, name) for name in ITEM.ordered_fieldnames)) for item in items]
    return struct.pack("<HHHHH", *header.values()) + b"".join(rows)


def decode(content):
    """The header and the items of a file, as `wp ftp` of MAVProxy reads it."""
    rows = [ITEM.unpacker.unpack_from(content, at) for at in range(10, len(content), ITEM.unpacker.size)]
    items = [ITEM(**dict(zip(ITEM.ordered_fieldnames, row, strict=True))) for row in rows]
    return struct.unpack_from("<HHHHH", content), items


def test_mission_is_written_and_read(ftp_station, station):
    client = ftp_station(station.rig)
    items = [*station.mission(3), station.item(4, Command.JUMP, frame=2, x=0, y=0, params=(2.0, 1.0, 0.0, 0.0))]
    assert client.put(MISSION, encode(items)).ok
    plan = station.handler.plans().of(PlanKind.MISSION)
    assert [item.x for item in plan.items] == [360_000_001, 360_000_002, 360_000_003, 0]
    assert plan.items[-1].params[0] == 1.0  # home is not counted in the plan
    header, read_items = decode(client.get(MISSION))
    assert header == (0x763D, 0, 0, 0, 5)
    assert station.all_fields(read_items[1:]) == station.all_fields(items[1:])
    numbers = [(item.seq, item.target_system, item.target_component, item.current) for item in read_items]
    assert numbers == [(sequence, 0, 0, 0) for sequence in range(5)]


def test_fence_and_rally_points_are_written_and_read(ftp_station, station):
    client = ftp_station(station.rig)
    circle = station.item(0, Command.INCLUDED_CIRCLE, kind=1, frame=0, params=(100.0, 0.0, 0.0, 0.0))
    assert client.put("@MISSION/fence.dat", encode([circle], 1)).ok
    assert client.put("@MISSION/rally.dat", encode([station.item(0, Command.RALLY_POINT, kind=2, frame=3)], 2)).ok
    assert [len(station.handler.plans().of(kind).items) for kind in PlanKind] == [0, 1, 1]
    assert decode(client.get("@MISSION/rally.dat"))[0] == (0x763D, 2, 0, 0, 1)
    assert client.put("@MISSION/fence.dat", encode([], 1)).ok
    assert decode(client.get("@MISSION/fence.dat")) == ((0x763D, 1, 0, 0, 0), [])


def test_refused_file_keeps_the_old_plan_and_gives_the_reason(ftp_station, station, texts):
    client = ftp_station(station.rig)
    items = station.mission(3)
    assert client.put(MISSION, encode(items)).ok
    plans = station.handler.plans()
    items[2] = station.item(2, command=9999)
    client.ask(Opcode.CREATE, MISSION)
    client.ask(Opcode.WRITE, encode(items))
    replies = station.rig.send(client.request(Opcode.TERMINATE))
    assert any(text.startswith("@MISSION/mission.dat: item 2: ") for text in texts(replies))
    assert station.handler.plans() == plans


TWO = [ITEM(0, 0, number, 6, Command.WAYPOINT, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0) for number in (0, 1)]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "shorter"),
        (encode(TWO, magic=1), "begins with"),
        (encode(TWO, 1), "plan type 1"),
        (encode(TWO, options=1), "partial"),
        (encode(TWO, first=1), "partial"),
        (encode(TWO, count=3), "do not match 3"),
        (encode(TWO)[:-1], "do not match 2"),
        (encode(TWO, count=2002), "at most"),
        (encode([TWO[0], TWO[0]]), "is numbered 0"),
        (encode([TWO[0], ITEM(0, 0, 1, 6, 21, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0)]), "command 21 is not known"),
        (encode([TWO[0], ITEM(0, 0, 1, 2, Command.JUMP, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0)]), "param1 is home"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_invalid_file_is_refused(content, reason):
    problem = unpack(content, PlanKind.MISSION, 1)
    assert isinstance(problem, PlanProblem)
    assert reason in problem.text
    assert problem.index in (None, 0)
    assert problem.result is not PlanResult.ACCEPTED


def test_first_item_is_part_of_a_plan_without_home():
    assert unpack(encode(TWO), PlanKind.MISSION, 0) == Plan.of(
        PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 6, True, x=1, y=1)] * 2
    )


def test_worker_thread_encodes_and_validates_plans(stored, station, monkeypatch):
    """2000 items take more time than a tick has left."""
    rig, client = stored(background=True)
    is_main_thread = []

    def record_thread(function):
        def recorded(*arguments):
            is_main_thread.append(threading.current_thread() is threading.main_thread())
            return function(*arguments)

        return recorded

    for name in ("pack", "unpack"):
        monkeypatch.setattr(plan_file, name, record_thread(getattr(plan_file, name)))

    def ask(*request, **fields):
        replies = client.all(*request, **fields)
        for _ in range(100):  # until the worker has finished
            if replies:
                break
            assert select.select(rig.endpoint.descriptors()[-1:], [], [], 20.0)[0]
            rig.endpoint.service(rig.now_s, rig.endpoint.descriptors()[-1:])
            replies = client.replies(rig.replies())
        assert replies[0].ok, replies[0].error
        return replies[0].data

    try:
        ask(Opcode.CREATE, MISSION)
        ask(Opcode.WRITE, encode(station.mission(2)))
        ask(Opcode.TERMINATE)
        assert len(rig.request_handler.plans().of(PlanKind.MISSION).items) == 2
        checksum = ask(Opcode.CHECKSUM, MISSION)
        ask(Opcode.OPEN_READ, MISSION)
        content = ask(Opcode.READ, offset=0, size=239)
        assert decode(content)[0] == (0x763D, 0, 0, 0, 3)
        assert int.from_bytes(checksum, "little") == mavlink_crc32(content)
    finally:
        rig.endpoint.close()
    assert is_main_thread == [False] * 3


def test_new_plan_is_reported_to_all_stations(ftp_station, station, texts):
    client = ftp_station(station.rig)
    client.ask(Opcode.CREATE, MISSION)
    client.ask(Opcode.WRITE, encode(station.mission(3)))
    assert texts(station.rig.send(client.request(Opcode.TERMINATE))) == ["New mission: items 1 to 3"]


@pytest.mark.parametrize(("reason", "text"), [("armed in AUTO", "armed in AUTO"), ("", "refused")])
def test_plan_that_the_boat_refuses_is_reported_with_its_reason(ftp_station, station, texts, reason, text):
    client = ftp_station(station.rig)
    station.handler.answer = Answer(Verdict.DENIED, reason)
    client.ask(Opcode.CREATE, MISSION)
    client.ask(Opcode.WRITE, encode(station.mission(3)))
    replies = station.rig.send(client.request(Opcode.TERMINATE))
    assert [text for text in texts(replies) if text.startswith("@MISSION")] == [f"@MISSION/mission.dat: {text}"]


@pytest.mark.parametrize(
    ("autopilot", "count", "text"),
    [(3, 4, "New mission: items 1 to 4"), (3, 0, "New mission: 0 items"), (0, 4, "New mission: 4 items")],
)
def test_new_mission_is_named_by_the_numbers_of_the_ground_station(autopilot, count, text):
    plan = Plan.of(PlanKind.MISSION, tuple(PlanItem(Command.WAYPOINT, x=1, y=n) for n in range(count)))
    assert new_plan_text(plan, autopilot) == text
