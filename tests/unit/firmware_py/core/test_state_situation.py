"""Situation in which requests for modes and goals are decided."""

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.reports import Home
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.state import State, settings_of, situation_of
from firmware_py.estimate import dead_reckoning
from firmware_py.faults.table import Fault
from firmware_py.guidance.fence import FenceState
from firmware_py.modes import ModeState, Situation
from firmware_py.plans.items import Command
from support.plans import FENCE_ITEMS

START = State.at_start(ParameterSet())
FRESH = Freshness(Age.FRESH, Age.FRESH, Age.FRESH)
FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCE_ITEMS))
RALLY = Plans(rally=Plan.of(PlanKind.RALLY, [PlanItem(Command.RALLY_POINT, 3, x=1, y=1)]))
MISSION = Plans(mission=Plan.of(PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=1, y=1)]))


def differences(state, freshness=FRESH):
    """Return the fields that differ from those of a boat without data."""
    situations = [situation_of(settings_of(each.parameters), each, ages) for each, ages in (
        (START, FRESH), (state, freshness),
    )]  # fmt: skip
    normal, present = situations
    values = ((name, getattr(present, name)) for name in Situation.__struct_fields__)
    return {name: value for name, value in values if value != getattr(normal, name)}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"home": Home(0.1, 0.2, 0.0)}, {"home_ok": True}),
        ({"plans": RALLY}, {"home_ok": True}),
        ({"plans": MISSION}, {"mission_ok": True}),
        (
            {"fault_latch": replace(START.fault_latch, active=1 << Fault.RUDDER_JAMMED)},
            {"fault": "rudder jammed"},
        ),
    ],
)
def test_situation_is_that_of_the_state(changes, expected):
    assert differences(replace(START, **changes)) == expected


@pytest.mark.parametrize("age", [Age.OLD, Age.AWAITED])
def test_values_must_be_fresh(age):
    values = situation_of(settings_of(START.parameters), START, FRESH)
    assert (values.heading_rad, values.position_ok, values.rudder_ok) == (0.0, True, True)
    expected = {"heading_rad": None, "position_ok": False, "rudder_ok": False}
    assert differences(START, Freshness(age, age, age)) == expected


@pytest.mark.parametrize(("margin_m", "expected"), [(-0.1, {"fence_breached": True}), (0.0, {}), (5.0, {})])
def test_fence_is_breached_with_a_negative_margin(margin_m, expected):
    fence = FenceState(FENCE.fence.identity, Place(0.1, 0.1), margin_m)
    guidance = replace(START.guidance, fence=fence, fence_enabled=True)
    assert differences(replace(START, plans=FENCE, guidance=guidance)) == expected


@pytest.mark.parametrize(
    ("armed", "age", "limit_m", "has_begun", "is_used"),
    [
        (True, Age.OLD, 500.0, True, True),
        (False, Age.OLD, 500.0, True, False),
        (True, Age.FRESH, 500.0, True, False),
        (True, Age.AWAITED, 500.0, True, False),
        (True, Age.OLD, 0.0, True, False),
        (True, Age.OLD, 500.0, False, False),
    ],
)
def test_dead_reckoning_is_used_while_armed_without_a_fix(armed, age, limit_m, has_begun, is_used):
    begun = dead_reckoning.begin(START.heading_estimator.water, 0.0) if has_begun else None
    position = replace(START.position, dead_reckoning=begun)
    state = State.at_start(ParameterSet().replaced("POS_RECKON_M", limit_m))
    state = replace(state, modes=ModeState(armed=armed), position=position)
    situation = situation_of(settings_of(state.parameters), state, replace(FRESH, position=age))
    assert (situation.dead_reckoning_sd_m is not None) is is_used
