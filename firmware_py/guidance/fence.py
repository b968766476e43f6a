"""Margin of the boat to the fence, updated in each tick."""

from __future__ import annotations

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan
from firmware_py.plans.fence import margin_m
from firmware_py.plans.items import MAX_DISTANCE_M

# The margin is recomputed when the boat has moved by more than this fraction of the last margin and this distance.
RECOMPUTE_FRACTION, RECOMPUTE_DISTANCE_M = 0.1, 2.0


class FenceState(msgspec.Struct, frozen=True):
    """Margin of a place to the fence with checksum `identity`; used until the boat has moved."""

    identity: int = 0
    place: Place | None = None
    margin_m: float = MAX_DISTANCE_M


def update(state: FenceState, plan: Plan, place: Place) -> FenceState:
    """Return the state with the margin at a place, recomputed when the boat has moved."""
    if state.identity == plan.identity and state.place is not None:
        moved_m, _ = state.place.distance_and_bearing(place)
        if moved_m <= max(RECOMPUTE_DISTANCE_M, RECOMPUTE_FRACTION * abs(state.margin_m)):
            return state
    return FenceState(plan.identity, place, margin_m(plan, place))
