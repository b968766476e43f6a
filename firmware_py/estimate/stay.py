"""Detect a compass that settles on a heading far from the estimate: a sea has turned the boat, or the compass jumped.

If its samples show the turn from the estimate to there, at a rate that a boat can have, the boat has turned.

Numeric core: functions over floats and NamedTuples without I/O, which the laboratory compiles as they stand
(hil/lab/numeric_core.py); NaN is absence.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import radians, wrap_pi

STAYED_S: Final = 2.0  # after which the compass has settled; a heading that turns without end is not a boat's
STAYED_RAD: Final = radians(15.0)
SPIN_RAD_S: Final = radians(90.0)  # yaw rate of a boat that a breaking sea turns
SPIN_NOISE_RAD: Final = radians(3.0)


class Stay(NamedTuple):
    """The heading around which a compass stays, since when (NaN: it does not), and whether it was seen to turn there.

    It is outside of the gate around the estimate.
    """

    around_rad: float = 0.0
    since_s: float = math.nan
    turned: bool = False


NO_STAY: Final = Stay()


def stays(before: Stay, t_s: float, heading_rad: float, reach_rad: float, last_rad: float, left: bool) -> Stay:  # noqa: FBT001 - compiled
    """Return the stay after a heading outside of the gate.

    `last_rad` is the heading before (NaN: none), `left`: that one was inside. A heading that differs from it by more
    than reach_rad has jumped.
    """
    turns, stayed = abs(wrap_pi(heading_rad - last_rad)) <= reach_rad, not math.isnan(before.since_s)
    if stayed and turns and not left and abs(wrap_pi(heading_rad - before.around_rad)) <= STAYED_RAD:
        return before
    return Stay(heading_rad, t_s, turns and (left or (stayed and before.turned)))
