"""Where a watch circle lies when a fence is near: moved inward, and only where there is no room for that made smaller.

A boat that cannot stop swings out of her circle at times: after she has come in, when the current turns, and all the
time where the circle is smaller than she can hold. So between circle and fence there must be room for that. A place
with the room is looked for on rings about the place that was asked for, one place each time guidance is carried out,
because a fence may have thousands of edges. The rings are spaced for a straight fence, for a corner and for a bight.
"""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI
from firmware_py.common.plan import Plan
from firmware_py.guidance.tasks import HoldStation, TaskSettings
from firmware_py.plans import fence

HELD_RADII = 5.0  # of the turning circle: in a smaller watch circle no current lets her stay
SWING_RADII = 3.5  # so far she comes out of one: of any size, after a turn that the current has drawn out
RINGS = (1.02, 1.5, 2.2)  # of what is lacking; the first finds a straight fence from 11 degrees off its normal
BEARINGS = 16
WORTH = 0.3  # of the way that it is moved: at least so much room must be gained
SAME_M = 1.0


class LoiterPlacement(msgspec.Struct, frozen=True):
    """The circle for a task that a fence bounds, while `tries` places have been looked at; `found`: no more of them.

    `circle` is the best so far, `margin_m` the way from its centre to the fence with the checksum `identity`,
    `asked_margin_m` that from the centre that was asked for.
    """

    task: HoldStation
    identity: int
    circle: HoldStation
    margin_m: float
    asked_margin_m: float
    tries: int = 0
    found: bool = False


def min_radius_m(settings: TaskSettings) -> float:
    """Return the radius of the smallest watch circle that she can hold in a current, metres."""
    return HELD_RADII * settings.turning_radius_m


def overshoot_m(settings: TaskSettings) -> float:
    """Return how far out of a watch circle she may come, metres."""
    return SWING_RADII * settings.turning_radius_m


def update(
    settings: TaskSettings, placement: LoiterPlacement | None, task: HoldStation, plan: Plan | None
) -> LoiterPlacement | None:
    """Look at the next place for a watch circle; None where no fence is heeded. `plan` is the fence."""
    if plan is None or not plan.items:
        return None
    if placement is None or placement.task != task or placement.identity != plan.identity:
        return _asked_for(settings, task, plan)
    if placement.found:
        return placement
    if placement.tries == len(RINGS) * BEARINGS:
        return replace(placement, circle=_shrunk(settings, placement), found=True)
    ring, bearing = divmod(placement.tries, BEARINGS)
    clear_m, bearing_rad = task.radius_m + overshoot_m(settings), bearing * TWO_PI / BEARINGS
    length_m = RINGS[ring] * (clear_m - placement.asked_margin_m)
    way = length_m * math.cos(bearing_rad), length_m * math.sin(bearing_rad)
    place = task.centre.at_offset(*way)
    margin_m = fence.margin_m(plan, place)
    placement = replace(placement, tries=placement.tries + 1)
    gains = margin_m > max(placement.margin_m, placement.asked_margin_m + WORTH * length_m)
    if gains and _is_open(plan, placement, way, margin_m):
        placement = replace(placement, circle=HoldStation(place, task.radius_m), margin_m=margin_m)
    return replace(placement, found=placement.margin_m >= clear_m)


def _asked_for(settings: TaskSettings, task: HoldStation, plan: Plan) -> LoiterPlacement:
    """Begin with the place that was asked for; one as far outside the fence as that is not what this is for."""
    margin_m, clear_m = fence.margin_m(plan, task.centre), task.radius_m + overshoot_m(settings)
    return LoiterPlacement(
        task, plan.identity, task, margin_m, margin_m, found=margin_m >= clear_m or margin_m < -clear_m
    )


def _is_open(plan: Plan, placement: LoiterPlacement, way: tuple[float, float], margin_m: float) -> bool:
    """Whether no fence lies on the way: none is nearer to its ends than their margins; between those one is tried."""
    length_m = math.hypot(*way)
    from_m, to_m = abs(placement.asked_margin_m), length_m - margin_m
    if to_m <= from_m + SAME_M:
        return True
    part = 0.5 * (from_m + to_m) / length_m
    return fence.margin_m(plan, placement.task.centre.at_offset(part * way[0], part * way[1])) > 0.0


def _shrunk(settings: TaskSettings, placement: LoiterPlacement) -> HoldStation:
    """Return the circle with the radius that there is room for, no smaller than she can hold."""
    room_m = max(placement.margin_m - overshoot_m(settings), min_radius_m(settings))
    return replace(placement.circle, radius_m=min(placement.task.radius_m, room_m))
