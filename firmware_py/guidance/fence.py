"""The margin of the boat to the fence, from tick to tick."""

from __future__ import annotations

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan
from firmware_py.plans.fence import margin_m
from firmware_py.plans.items import FARTHEST_M

# The distance is computed anew when the boat has gone this part of the last one, or so far.
MOVED_PART, MOVED_M = 0.1, 2.0


class FenceState(msgspec.Struct, frozen=True):
    """The margin at a place, of the fence with checksum `identity`; kept until the boat has moved."""

    identity: int = 0
    place: Place | None = None
    margin_m: float = FARTHEST_M


def update(state: FenceState, plan: Plan, place: Place) -> FenceState:
    """Return the state with the margin at a place, computed anew when the boat has moved."""
    if state.identity == plan.identity and state.place is not None:
        moved_m, _ = state.place.distance_and_bearing(place)
        if moved_m <= max(MOVED_M, MOVED_PART * abs(state.margin_m)):
            return state
    return FenceState(plan.identity, place, margin_m(plan, place))
