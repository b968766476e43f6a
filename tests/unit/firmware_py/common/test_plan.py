"""Plans: identity, storage as text, and rounding."""

import json
import math
import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import (
    Plan,
    PlanItem,
    PlanKind,
    Plans,
    first_item_number,
    from_text,
    limit_number,
    place_of,
    to_text,
)
from support.stored_numbers import assert_mavlink_numbers

singles = st.floats(width=32)
ints = st.integers(-(2**31), 2**31 - 1)
items = st.builds(
    PlanItem,
    command=st.integers(0, 65535),
    frame=st.integers(0, 255),
    autocontinue=st.booleans(),
    params=st.tuples(singles, singles, singles, singles),
    x=ints,
    y=ints,
    z=singles,
)
WAYPOINT, INCLUDED_CIRCLE = 16, 5003  # MAV_CMD
RELATIVE_ALTITUDE = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
HERE = PlanItem(WAYPOINT, RELATIVE_ALTITUDE, x=360_000_000, y=1_210_000_000)


def test_identity_is_zero_for_an_empty_plan_and_differs_for_each_change():
    assert Plan.of(PlanKind.RALLY, ()).identity == 0
    assert Plans() == Plans(*(Plan.of(kind, ()) for kind in PlanKind))
    plan = Plan.of(PlanKind.MISSION, (HERE, HERE))
    assert plan.identity != 0
    zero_crc = PlanItem(WAYPOINT, y=762_503_330)
    assert Plan.of(PlanKind.MISSION, (zero_crc,)).identity == 1
    assert repr(HERE) in repr(plan)
    others = [
        (HERE,),
        (HERE, PlanItem(WAYPOINT, RELATIVE_ALTITUDE, x=360_000_001, y=1_210_000_000)),
        (HERE, HERE, HERE),
    ]
    assert all(Plan.of(PlanKind.MISSION, other) != plan for other in others)
    unused = PlanItem(WAYPOINT, RELATIVE_ALTITUDE, params=(0.0, 0.0, 0.0, math.nan))
    assert Plan.of(PlanKind.MISSION, (unused,)) == Plan.of(PlanKind.MISSION, (unused,))


def test_damaged_text_is_rejected():
    text = to_text(Plan.of(PlanKind.MISSION, (HERE,)))
    items = json.loads(text)["plan"]["items"]
    other_items = items[:-4] + ("A" if items[-4] != "A" else "B") + items[-3:]
    changes = [
        (items, other_items),
        (items, items[:-4]),
        (items, "!" + items[1:]),
        (items, "!" + items),
        ('"kind":0', '"kind":3'),
    ]
    identity = f'"identity":{json.loads(text)["plan"]["identity"]}'
    changes += [(identity, identity + ".0"), ('"kind":0', '"kind":0.0'), ('"kind":0', '"kind":false')]
    changes += [('"kind":0', '"kind":null'), ('"kind":0,', ""), ('"kind":0', '"kind":' + "[" * 100_000), (text, "")]
    for damaged in (text[:-2], "[]", *(text.replace(old, new) for old, new in changes)):
        assert damaged != text
        with pytest.raises(ValueError):
            from_text(damaged)


@pytest.mark.parametrize(
    ("x", "y", "place_deg"),
    [
        (0, 0, None),
        (1, 0, (1e-7, 0.0)),
        (0, -1, (0.0, -1e-7)),
        (900_000_000, -1_800_000_000, (90.0, -180.0)),
        (-900_000_000, 1_800_000_000, (-90.0, 180.0)),
        (900_000_001, 0, None),
        (-900_000_001, 0, None),
        (0, 1_800_000_001, None),
        (0, -1_800_000_001, None),
    ],
)
def test_place_of_an_item(x, y, place_deg):
    expected = None if place_deg is None else Place(*map(math.radians, place_deg))
    place = place_of(PlanItem(WAYPOINT, x=x, y=y))
    assert place == expected or msgspec.structs.astuple(place) == pytest.approx(msgspec.structs.astuple(expected))


def test_kinds_are_the_mission_types_of_mavlink():
    assert_mavlink_numbers(PlanKind, "MAV_MISSION_TYPE_{}")


def test_parameter_of_an_item_is_limited_and_nan_counts_as_0():
    assert [limit_number(value, -1.0, 2.0) for value in (-1.5, 0.5, 2.5, math.nan)] == [-1.0, 0.5, 2.0, 0.0]


def test_mission_items_of_ardupilot_ground_stations_count_from_1():
    assert [first_item_number(0, kind) for kind in PlanKind] == [0, 0, 0]
    assert [first_item_number(ARDUPILOT, kind) for kind in PlanKind] == [1, 0, 0]


@pytest.mark.parametrize(
    ("changes", "notes"),
    [
        ({"version": 2}, ["written by a later version (2, here 1), read by name"]),
        ({"version": "1"}, ["written by a later version ('1', here 1), read by name"]),
        (
            {"colour": 1, "age": 2},
            ["field 'age' is not known here, ignored", "field 'colour' is not known here, ignored"],
        ),
        ({"version": 0}, []),
    ],
)
def test_unknown_parts_of_a_stored_plan_are_ignored_and_reported(changes, notes):
    plan = Plan.of(PlanKind.MISSION, (HERE,))
    stored = json.loads(to_text(plan)) | changes
    stored["plan"]["speed"] = 1
    assert from_text(json.dumps(stored)) == (plan, (*notes, "plan: field 'speed' is not known here, ignored"))


def test_replaced_plan_does_not_change_the_others():
    fence = Plan.of(PlanKind.FENCE, (PlanItem(INCLUDED_CIRCLE),))
    plans = Plans().replaced(fence)
    assert plans.of(PlanKind.FENCE) is fence
    assert (plans.mission, plans.rally) == (Plans().mission, Plans().rally)


def test_numbers_are_rounded_to_mavlink_precision_or_rejected():
    (item,) = Plan.of(PlanKind.MISSION, (PlanItem(WAYPOINT, params=(0.1, 0.0, -math.nan, 0.0), z=1e-60),)).items
    assert item.params[0] == struct.unpack("f", struct.pack("f", 0.1))[0]
    assert item.z == 0.0
    for invalid in (
        PlanItem(WAYPOINT, z=1e300),
        PlanItem(WAYPOINT, x=2**31),
        PlanItem(70_000),
        PlanItem(WAYPOINT, frame=-1),
    ):
        with pytest.raises(struct.error):
            Plan.of(PlanKind.MISSION, (invalid,))


@given(st.sampled_from(PlanKind), st.lists(items, max_size=5))
def test_plan_is_written_and_read(kind, plan_items):
    plan = Plan.of(kind, plan_items)
    restored, notes = from_text(to_text(plan))
    assert notes == ()
    assert restored == plan
    assert repr(restored) == repr(plan)  # NaN is not equal to itself, but has the same repr
