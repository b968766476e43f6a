"""Variation that a compass states beside a declination that is configured.

Some instruments state a variation of 0.0 because they do not know any, some that of another place, and some (early
versions of Signal K) state it in the field of the deviation. The configured declination wins over a stated one that is
0.0 or differs from it by more than MAX_DIFFERENCE_RAD. A declination of None is not configured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from firmware_py.common.angles import degrees, radians, wrap_pi, wrap_two_pi
from firmware_py.common.records import Event, HeadingSample, NorthReference, Severity

MAX_DIFFERENCE_RAD: Final = radians(3.0)
MAX_DEVIATION_RAD: Final = radians(15.0)  # of a compass that steers a boat

UnusedVariations = tuple[float | None, float | None]  # the variation that compass A and B state and that is not used


def stated_rad(sample: HeadingSample, declination_rad: float | None) -> float | None:
    """Return the variation that is part of the heading, or None.

    A magnetic heading may contain a deviation. It is a variation if it is too large for a deviation, or is as large as
    the declination.
    """
    stated = sample.variation_rad
    if stated is None or sample.reference is NorthReference.TRUE or abs(stated) > MAX_DEVIATION_RAD:
        return stated
    same = (
        declination_rad is not None
        and abs(declination_rad) > MAX_DIFFERENCE_RAD
        and abs(stated - declination_rad) <= MAX_DIFFERENCE_RAD
    )
    return stated if same else None


def apply(sample: HeadingSample, declination_rad: float | None) -> HeadingSample:
    """Return the heading from true north if its variation is used, else from magnetic north."""
    stated = stated_rad(sample, declination_rad)
    if stated is None or not math.isfinite(sample.heading_rad):
        return sample
    if declination_rad is not None and (stated == 0.0 or abs(wrap_pi(stated - declination_rad)) > MAX_DIFFERENCE_RAD):
        magnetic_rad = wrap_two_pi(sample.heading_rad - stated)
        return replace(sample, heading_rad=magnetic_rad, reference=NorthReference.MAGNETIC, variation_rad=None)
    return sample if sample.reference is NorthReference.TRUE else replace(sample, reference=NorthReference.TRUE)


def check(
    before: UnusedVariations, samples: Sequence[HeadingSample], declination_rad: float | None
) -> tuple[UnusedVariations, tuple[Event, ...]]:
    """Return the stated variations that are not used, or not as stated, and the events of a change."""
    odd, events = list(before), []
    for sample in samples:
        stated, name = stated_rad(sample, declination_rad), "B" if sample.source == 1 else "A"
        if sample.variation_rad is None or sample.source not in {0, 1}:
            continue
        misplaced = stated is not None and sample.reference is NorthReference.MAGNETIC
        differs = stated and declination_rad is not None and abs(wrap_pi(stated - declination_rad)) > MAX_DIFFERENCE_RAD
        unused = stated if misplaced or differs else None
        reported = odd[sample.source]
        if (unused is None) == (reported is None) and abs((unused or 0.0) - (reported or 0.0)) < MAX_DIFFERENCE_RAD:
            continue
        odd[sample.source] = unused
        if unused is None:
            events.append(Event(Severity.INFO, f"Compass {name}: stated variation agrees"))
            continue
        text = f"Compass {name} states deviation {_text(unused)}: used as variation"
        if differs:
            field = "deviation" if misplaced else "variation"
            text = f"Compass {name} states {field} {_text(unused)}: {_text(declination_rad or 0.0)} is used"
        events.append(Event(Severity.WARNING, text))
    return (odd[0], odd[1]), tuple(events)


def _text(angle_rad: float) -> str:
    return f"{abs(degrees(angle_rad)):.1f} {'E' if angle_rad >= 0.0 else 'W'}"
