"""Where a compass stays that shows what the estimate does not: a sea has knocked her round, or it has jumped.

One that was seen to turn there, from sample to sample as something turns that is hit, was with the boat.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.common.angles import radians, wrap_pi

STAYED_S: Final = 2.0  # and it has come to rest; what turns without end is no boat
STAYED_RAD: Final = radians(15.0)
SPIN_RAD_S: Final = radians(90.0)  # as fast as a breaking sea may turn her
SPIN_NOISE_RAD: Final = radians(3.0)


class Stay(msgspec.Struct, frozen=True):
    """Around what heading a compass stays, since when, and whether it was seen to turn there from the estimate."""

    around_rad: float
    since_s: float
    turned: bool


def stays(
    before: Stay | None, t_s: float, heading_rad: float, reach_rad: float, last_rad: float | None, *, left: bool
) -> Stay:
    """Take in a heading that the estimate does not show; `left`: the one before, last_rad, was in agreement.

    What differs from the one before by more than reach_rad has not turned.
    """
    leaps = last_rad is None or abs(wrap_pi(heading_rad - last_rad)) > reach_rad
    if before is None or left or leaps or abs(wrap_pi(heading_rad - before.around_rad)) > STAYED_RAD:
        turned = not leaps and (left or (before is not None and before.turned))
        return Stay(heading_rad, t_s, turned)
    return before
