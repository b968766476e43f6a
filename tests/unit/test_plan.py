import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.plan import MOST_ITEMS, Plan, PlanItem, PlanKind, Plans, from_text, to_text
from firmware_py.plan_rules import PlanResult, fault_of

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
HERE = PlanItem(16, 6, x=360_000_000, y=1_210_000_000)


@given(st.sampled_from(PlanKind), st.lists(items, max_size=5))
def test_a_plan_is_read_back_as_it_was_written(kind, listed):
    plan = Plan.of(kind, listed)
    again = from_text(to_text(plan))
    assert again == plan
    assert repr(again) == repr(plan)  # NaN is not equal to itself, but looks the same


def test_an_empty_plan_has_no_identity_and_every_change_gives_another():
    assert Plan.of(PlanKind.RALLY, ()).identity == 0
    plan = Plan.of(PlanKind.MISSION, (HERE, HERE))
    assert plan.identity != 0
    others = [(HERE,), (HERE, PlanItem(16, 6, x=360_000_001, y=1_210_000_000)), (HERE, HERE, HERE)]
    assert all(Plan.of(PlanKind.MISSION, other) != plan for other in others)
    unused = PlanItem(16, 6, params=(0.0, 0.0, 0.0, math.nan))
    assert Plan.of(PlanKind.MISSION, (unused,)) == Plan.of(PlanKind.MISSION, (unused,))


def test_a_stored_plan_that_was_touched_is_refused():
    text = to_text(Plan.of(PlanKind.MISSION, (HERE,)))
    for touched in (text.replace("360000000", "360000001"), text[:-2], "", "[]", text.replace("16", "65536")):
        with pytest.raises(ValueError):
            from_text(touched)


def test_replacing_one_plan_leaves_the_others():
    fence = Plan.of(PlanKind.FENCE, (PlanItem(5003),))
    plans = Plans().replaced(fence)
    assert plans.of(PlanKind.FENCE) is fence
    assert (plans.mission, plans.rally) == (Plans().mission, Plans().rally)


def test_too_many_items_and_an_altitude_that_is_no_number_are_refused():
    assert fault_of(Plan.of(PlanKind.MISSION, [HERE] * MOST_ITEMS)) is None
    assert fault_of(Plan.of(PlanKind.MISSION, [HERE] * (MOST_ITEMS + 1))).result is PlanResult.NO_SPACE
    fault = fault_of(Plan.of(PlanKind.MISSION, (HERE, PlanItem(16, z=math.nan))))
    assert (fault.index, fault.result) == (1, PlanResult.INVALID_PARAM7)
