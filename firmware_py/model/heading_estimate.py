"""Input of the control law. Numeric core, like kt.py."""

from __future__ import annotations

from typing import NamedTuple


class HeadingEstimate(NamedTuple):
    """Input of the control law: heading and yaw rate without wave yaw, rudder bias and speed.

    `bias_rad` is the rudder angle at which the boat goes straight, `bias_mean_rad` its mean over minutes, `speed_m_s`
    the mean speed through the water and `speed_sd_m_s` its standard deviation, `correction_rad2_s` the variance per
    second by which measurements correct the heading.
    """

    heading_rad: float
    correction_rad2_s: float
    yaw_rate_rad_s: float
    bias_rad: float
    bias_mean_rad: float
    speed_m_s: float
    speed_sd_m_s: float
