"""Whether the boat turns the other way than its rudder is to turn it: a servo that is set up the wrong way round."""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, exact_step
from firmware_py.safety.turn_order import FAR_RUDDER_RAD, LATE_S, LEAST_S, MEMORY_S, is_enough, ordered_s

REVERSED: Final = -0.5  # of the turn that the model expects, and the more the worse, is one the wrong way
SURE_RAD: Final = radians(60.0)  # so much of it is one, however slow she is taken for, and uncertain the heading
# The estimate may take a turn that it does not expect for waves; the compass does not, once it is larger than theirs.
SHOWN_REVERSED, SHOWN_TURN_RAD = -0.6, radians(150.0)


class Turn(msgspec.Struct, frozen=True):
    """A stretch of time: its mean rudder, what she turned in it by the estimate and by the compass, its length."""

    rudder_rad: float
    turned_rad: float
    shown_rad: float
    step_s: float


class Evidence(msgspec.Struct, frozen=True):
    """For how long the rudder has told of one and the same, what she should have turned in it, and what she has."""

    telling_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0


class WrongWay(msgspec.Struct, frozen=True):
    """Whether she turns the wrong way with RUD_REVERSE as `servo_reversed` says, and what speaks for a change of that.

    `rate_rad_s` is the yaw rate that the model has with no more trim than there can be. `order_s`: for how long the
    rudder has ordered a turn to starboard, negative to port.
    """

    rate_rad_s: float = 0.0
    order_s: float = 0.0
    by_estimate: Evidence = Evidence()
    by_compass: Evidence = Evidence()
    reversed: bool = False
    servo_reversed: bool = False


def update(
    model: KtModel,
    way: WrongWay,
    turn: Turn,
    slow_rudder_rad: float,
    error_rad: float | None,
    heading_sd_rad: float,
) -> WrongWay:
    """Judge whether the boat turns the other way than its rudder is to turn it; an error of None is by hand.

    What a rudder that is set up the wrong way round makes her do is slow at first, and looks like trim; so no more of
    it is taken for trim than there can be, and none of the turn.
    """
    step_s = turn.step_s
    over_rad = turn.rudder_rad - clamp(slow_rudder_rad, -FAR_RUDDER_RAD, FAR_RUDDER_RAD)
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(way.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    order_s = ordered_s(way.order_s, over_rad, error_rad, step_s)
    way = replace(way, rate_rad_s=rate_rad_s, order_s=order_s)
    if abs(order_s) <= LATE_S:
        if order_s != 0.0:
            return way
        keep = math.exp(-step_s / MEMORY_S)
        return replace(way, by_estimate=_faded(way.by_estimate, keep), by_compass=_faded(way.by_compass, keep))
    # What speaks against what has been found: that she turns the wrong way, or the right one again.
    sign = math.copysign(1.0, -expected_rad if way.reversed else expected_rad)
    block = Evidence(step_s, abs(expected_rad), sign * turn.turned_rad)
    by_estimate = _taken(way.by_estimate, block, REVERSED)
    by_compass = _taken(way.by_compass, replace(block, turned_rad=sign * turn.shown_rad), SHOWN_REVERSED)
    # An estimate that does not know of it takes a turn the wrong way for lost way, and expects next to none.
    most_rad = max(by_estimate.expected_rad, -by_estimate.turned_rad)
    estimated = is_enough(by_estimate.telling_s, most_rad, heading_sd_rad, model.turning_lag_s)
    estimated |= by_estimate.telling_s >= LEAST_S and -by_estimate.turned_rad >= SURE_RAD
    # An estimate that has been led astray is not believed alone.
    shown = by_compass.expected_rad >= SHOWN_TURN_RAD
    if shown or (estimated and (not way.reversed or by_compass.telling_s >= LEAST_S)):
        return WrongWay(rate_rad_s, order_s, reversed=not way.reversed, servo_reversed=way.servo_reversed)
    return replace(way, by_estimate=by_estimate, by_compass=by_compass)


def _faded(evidence: Evidence, keep: float) -> Evidence:
    return Evidence(keep * evidence.telling_s, keep * evidence.expected_rad, keep * evidence.turned_rad)


def _taken(evidence: Evidence, block: Evidence, share: float) -> Evidence:
    """Return the evidence with a block more, none as long as she does not turn against what was found by a share."""
    expected_rad, turned_rad = evidence.expected_rad + block.expected_rad, evidence.turned_rad + block.turned_rad
    if turned_rad > share * expected_rad:
        return Evidence()
    return Evidence(evidence.telling_s + block.telling_s, expected_rad, turned_rad)
