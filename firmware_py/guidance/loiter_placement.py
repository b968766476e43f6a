"""Placement of a loiter circle near a fence: the circle is moved inward, or made smaller if there is no room.

The boat cannot stop and overshoots its circle: after it has entered, when the current turns, and always if the circle
is smaller than `min_radius_m`. The distance to the fence must include this overshoot. Candidate centres are on rings
around the requested one; their radii suit a straight fence, a corner and a bay. Each update tries one candidate,
because a fence may have thousands of edges.
"""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI
from firmware_py.common.plan import Plan
from firmware_py.guidance.tasks import HoldStation, TaskSettings
from firmware_py.plans import fence

MIN_LOITER_RADII = 5.0  # in turning radii; in a current the boat cannot stay in a smaller circle
OVERSHOOT_RADII = 3.5  # in turning radii, for any circle; a current stretches the turn
RING_FACTORS = (1.02, 1.5, 2.2)  # of the missing margin; the first suits a straight fence, up to 11 deg off its normal
BEARINGS_PER_RING = 16
MIN_GAIN_FRACTION = 0.3  # minimum gain of margin per metre moved
MARGIN_TOLERANCE_M = 1.0


class LoiterPlacement(msgspec.Struct, frozen=True):
    """Loiter circle of a task within a fence, after `tries` candidates; `is_final`: the search has ended.

    `circle` is the best so far, `margin_m` the distance from its centre to the fence with the checksum `identity`, and
    `requested_margin_m` the distance from the requested centre.
    """

    task: HoldStation
    identity: int
    circle: HoldStation
    margin_m: float
    requested_margin_m: float
    tries: int = 0
    is_final: bool = False


def min_radius_m(settings: TaskSettings) -> float:
    """Return the radius of the smallest loiter circle in which the boat can stay in a current."""
    return MIN_LOITER_RADII * settings.turning_radius_m


def overshoot_m(settings: TaskSettings) -> float:
    """Return the maximum distance of the boat outside its loiter circle."""
    return OVERSHOOT_RADII * settings.turning_radius_m


def update(
    settings: TaskSettings, placement: LoiterPlacement | None, task: HoldStation, plan: Plan | None
) -> LoiterPlacement | None:
    """Try the next candidate; return None without an enabled fence (`plan`)."""
    if plan is None or not plan.items:
        return None
    if placement is None or placement.task != task or placement.identity != plan.identity:
        return _start_search(settings, task, plan)
    if placement.is_final:
        return placement
    if placement.tries == len(RING_FACTORS) * BEARINGS_PER_RING:
        return replace(placement, circle=_shrink(settings, placement), is_final=True)
    ring, bearing = divmod(placement.tries, BEARINGS_PER_RING)
    required_m, bearing_rad = task.radius_m + overshoot_m(settings), bearing * TWO_PI / BEARINGS_PER_RING
    distance_m = RING_FACTORS[ring] * (required_m - placement.requested_margin_m)
    offset_m = distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)
    centre = task.centre.at_offset(*offset_m)
    margin_m = fence.margin_m(plan, centre)
    placement = replace(placement, tries=placement.tries + 1)
    is_better = margin_m > max(placement.margin_m, placement.requested_margin_m + MIN_GAIN_FRACTION * distance_m)
    if is_better and _is_connected(plan, placement, offset_m, margin_m):
        placement = replace(placement, circle=HoldStation(centre, task.radius_m), margin_m=margin_m)
    return replace(placement, is_final=placement.margin_m >= required_m)


def _start_search(settings: TaskSettings, task: HoldStation, plan: Plan) -> LoiterPlacement:
    """Return the placement at the requested centre; it is final if the margin suffices or that is far outside."""
    margin_m, required_m = fence.margin_m(plan, task.centre), task.radius_m + overshoot_m(settings)
    return LoiterPlacement(
        task, plan.identity, task, margin_m, margin_m, is_final=margin_m >= required_m or margin_m < -required_m
    )


def _is_connected(plan: Plan, placement: LoiterPlacement, offset_m: tuple[float, float], margin_m: float) -> bool:
    """Return whether there is certainly no fence between the requested centre and a candidate.

    No fence is nearer to either end than the margin there. In the gap between the two margins there is no fence if the
    margin of its middle is at least half of the gap.
    """
    distance_m = math.hypot(*offset_m)
    from_m, to_m = abs(placement.requested_margin_m), distance_m - margin_m
    if to_m <= from_m + MARGIN_TOLERANCE_M:
        return True
    fraction = 0.5 * (from_m + to_m) / distance_m
    middle = placement.task.centre.at_offset(fraction * offset_m[0], fraction * offset_m[1])
    return fence.margin_m(plan, middle) >= 0.5 * (to_m - from_m)


def _shrink(settings: TaskSettings, placement: LoiterPlacement) -> HoldStation:
    """Return the circle reduced to the available room, but not below the minimum radius."""
    room_m = max(placement.margin_m - overshoot_m(settings), min_radius_m(settings))
    return replace(placement.circle, radius_m=min(placement.task.radius_m, room_m))
