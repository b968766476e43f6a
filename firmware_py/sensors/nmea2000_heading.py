"""The heading in the fields of PGN 127250."""

from __future__ import annotations

from typing import Final

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.records import NorthReference
from firmware_py.sensors.nmea2000_layout import Values

HEADING: Final = 127250
_TRUE, _MAGNETIC = 0, 1  # field `reference`

# Heading [rad], its reference, and the variation [rad, east positive] that the message states; None: not stated.
Heading = tuple[float, NorthReference, float | None]


def heading_of(values: Values) -> Heading | None:
    """Return the heading of a message, None without one or with an unknown reference.

    If the reference is magnetic, the field `heading_rad` is the reading of the sensor, as in HDG of NMEA 0183: the
    reading plus the deviation is the magnetic heading, and this plus the variation is the true heading (east positive).
    A missing deviation counts as 0.
    """
    heading_rad, reference, variation_rad = values["heading_rad"], values["reference"], values["variation_rad"]
    if heading_rad is None or reference not in (_TRUE, _MAGNETIC):
        return None
    if reference == _TRUE:
        return wrap_two_pi(heading_rad), NorthReference.TRUE, variation_rad
    magnetic_rad = heading_rad + (values["deviation_rad"] or 0.0)
    if variation_rad is None:
        return wrap_two_pi(magnetic_rad), NorthReference.MAGNETIC, None
    return wrap_two_pi(magnetic_rad + variation_rad), NorthReference.TRUE, variation_rad
