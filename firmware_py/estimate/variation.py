"""Comparison of the variation that a compass sends with the configured declination.

Some instruments send a variation of 0.0 because they have no value. Others send the variation of another place. Early
versions of Signal K send the variation in the field of the deviation. The configured declination replaces a variation
that is 0.0 or differs from it by more than MAX_DECLINATION_DIFFERENCE_RAD. Declination None: not configured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from firmware_py.common.angles import degrees, radians, wrap_pi, wrap_two_pi
from firmware_py.common.records import Event, HeadingSample, NorthReference, Severity

MAX_DECLINATION_DIFFERENCE_RAD: Final = radians(3.0)
MAX_DEVIATION_RAD: Final = radians(15.0)  # of a compass that is suitable for steering

UnusedVariations = tuple[float | None, float | None]  # of compass A and B; None: no variation, or used as sent


def find_variation(sample: HeadingSample, declination_rad: float | None) -> float | None:
    """Return the variation that the heading contains, or None.

    With a magnetic heading, the field normally contains a deviation. It is interpreted as a variation if it exceeds
    MAX_DEVIATION_RAD or is about equal to the declination.
    """
    variation_rad = sample.variation_rad
    if variation_rad is None or sample.reference is NorthReference.TRUE or abs(variation_rad) > MAX_DEVIATION_RAD:
        return variation_rad
    equals_declination = (
        declination_rad is not None
        and abs(declination_rad) > MAX_DECLINATION_DIFFERENCE_RAD
        and abs(variation_rad - declination_rad) <= MAX_DECLINATION_DIFFERENCE_RAD
    )
    return variation_rad if equals_declination else None


def apply(sample: HeadingSample, declination_rad: float | None) -> HeadingSample:
    """Return the sample as a true heading if its variation is used; otherwise as a magnetic heading without it."""
    variation_rad = find_variation(sample, declination_rad)
    if variation_rad is None or not math.isfinite(sample.heading_rad):
        return sample
    if declination_rad is not None and (
        variation_rad == 0.0 or abs(wrap_pi(variation_rad - declination_rad)) > MAX_DECLINATION_DIFFERENCE_RAD
    ):
        magnetic_rad = wrap_two_pi(sample.heading_rad - variation_rad)
        return replace(sample, heading_rad=magnetic_rad, reference=NorthReference.MAGNETIC, variation_rad=None)
    return sample if sample.reference is NorthReference.TRUE else replace(sample, reference=NorthReference.TRUE)


def find_unused(
    previous: UnusedVariations, samples: Sequence[HeadingSample], declination_rad: float | None
) -> tuple[UnusedVariations, tuple[Event, ...]]:
    """Return the variations that are not used as sent, and an event for each compass whose result has changed."""
    unused, events = list(previous), []
    for sample in samples:
        if sample.variation_rad is None or sample.source not in {0, 1}:
            continue
        variation_rad = find_variation(sample, declination_rad)
        compass = "AB"[sample.source]
        is_misplaced = variation_rad is not None and sample.reference is NorthReference.MAGNETIC
        is_different = (
            variation_rad is not None
            and variation_rad != 0.0
            and declination_rad is not None
            and abs(wrap_pi(variation_rad - declination_rad)) > MAX_DECLINATION_DIFFERENCE_RAD
        )
        unused_rad = variation_rad if is_misplaced or is_different else None
        reported_rad = unused[sample.source]
        if (unused_rad is None) == (reported_rad is None) and abs(
            (unused_rad or 0.0) - (reported_rad or 0.0)
        ) < MAX_DECLINATION_DIFFERENCE_RAD:
            continue
        unused[sample.source] = unused_rad
        if unused_rad is None:
            events.append(Event(Severity.INFO, f"Compass {compass}: stated variation agrees"))
            continue
        text = f"Compass {compass} states deviation {_format_angle(unused_rad)}: used as variation"
        if is_different:
            field = "deviation" if is_misplaced else "variation"
            declination_text = _format_angle(declination_rad or 0.0)
            text = f"Compass {compass} states {field} {_format_angle(unused_rad)}: {declination_text} is used"
        events.append(Event(Severity.WARNING, text))
    return (unused[0], unused[1]), tuple(events)


def _format_angle(angle_rad: float) -> str:
    """Return an angle in degrees with E or W."""
    return f"{abs(degrees(angle_rad)):.1f} {'E' if angle_rad >= 0.0 else 'W'}"
