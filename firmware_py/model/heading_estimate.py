"""The estimate that the control law takes. Numeric core, as kt.py beside it."""

from __future__ import annotations

from typing import NamedTuple


class HeadingEstimate(NamedTuple):
    """Input of the control law: heading and yaw rate without wave-frequency yaw, and the boat's response.

    `bias_rad` is the rudder angle at which the boat runs straight, `bias_mean_rad` its mean over minutes, `speed_m_s`
    the mean speed through the water, `correction_rad2_s` the variance per second by which measurements correct the
    heading; `_sd_`: standard deviation.
    """

    heading_rad: float
    correction_rad2_s: float
    yaw_rate_rad_s: float
    bias_rad: float
    bias_mean_rad: float
    speed_m_s: float
    speed_sd_m_s: float
