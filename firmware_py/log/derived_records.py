"""Derived quantities in the log. A replay does not read them; it computes them again. Units as in schema.py."""

from __future__ import annotations

from typing import Final

from firmware_py.common.reports import Snapshot
from firmware_py.log.message_rows import Row, flag_column, float_column, integer_column, optional_column

SLOW_INTERVAL_TICKS: Final = 10  # interval of all messages but NAV, EST and RUDE


def _ignore_record() -> None:
    """Return no record, since a replay computes it again."""


NAVIGATION: Final = Row(
    148,
    "NAV",
    (
        optional_column("Hdg", "r", "heading_rad"),
        flag_column("HdgOk", "heading_ok"),
        optional_column("YawR", "E", "yaw_rate_rad_s"),
        optional_column("Roll", "r", "roll_rad"),
        optional_column("Pitch", "r", "pitch_rad"),
        optional_column("Goal", "r", "goal_heading_rad"),
        optional_column("Err", "r", "heading_error_rad"),
        optional_column("Brg", "r", "bearing_rad"),
        optional_column("Dist", "m", "distance_m"),
        flag_column("PosOk", "position_ok"),
        float_column("Soft", "-", "gain_reduction"),
    ),
    _ignore_record,
)
GUIDANCE: Final = Row(
    153,
    "GDN",
    (
        integer_column("Do", "B", "navigation.activity"),
        optional_column("Lat", "r", "navigation.target_latitude_rad"),
        optional_column("Lng", "r", "navigation.target_longitude_rad"),
        optional_column("Rad", "m", "navigation.radius_m"),
        optional_column("XTrk", "m", "navigation.cross_track_m"),
        flag_column("Arr", "navigation.arrived"),
        optional_column("Fnc", "m", "navigation.fence_margin_m"),
        integer_column("MSt", "B", "mission.state"),
        optional_column("MItm", "-", "mission.index"),
    ),
    _ignore_record,
)
WATER: Final = Row(
    154,
    "WTR",
    (
        float_column("U", "n", "speed_m_s"),
        float_column("USd", "n", "speed_sd_m_s"),
        float_column("CN", "n", "current_north_m_s"),
        float_column("CE", "n", "current_east_m_s"),
        float_column("CSd", "n", "current_sd_m_s"),
        float_column("Lee", "r", "leeway_rad"),
        float_column("LSd", "r", "leeway_sd_rad"),
        flag_column("Strg", "too_strong"),
    ),
    _ignore_record,
)
ESTIMATE: Final = Row(
    151,
    "EST",
    (
        float_column("Hdg", "r", "heading_rad"),
        float_column("HSd", "r", "heading_sd_rad"),
        float_column("YawR", "E", "yaw_rate_rad_s"),
        integer_column("Src", "B", "source"),
        float_column("Bias", "r", "bias_rad"),
        float_column("BSd", "r", "bias_sd_rad"),
        float_column("WT", "s", "wave_period_s"),
        float_column("WSd", "r", "wave_sd_rad"),
        float_column("U", "n", "speed_m_s"),
        float_column("CN", "n", "current_north_m_s"),
        float_column("CE", "n", "current_east_m_s"),
        float_column("In", "r", "innovation_rad"),
        float_column("ISd", "r", "innovation_sd_rad"),
        float_column("I2", "-", "innovation_square"),
        float_column("P2", "-", "prediction_square"),
    ),
    _ignore_record,
)
ENERGY: Final = Row(
    155,
    "ENRG",
    (
        float_column("Trav", "r", "travel_rad"),
        integer_column("Rev", "Q", "reversals"),
        float_column("Enrg", "J", "energy_j"),
        float_column("TrvH", "r", "travel_rad_per_h"),
        float_column("RevH", "-", "reversals_per_h"),
        optional_column("Pow", "W", "power_w"),
        flag_column("Rest", "resting"),
    ),
    _ignore_record,
)
SUPPLY: Final = Row(
    158,
    "SUPL",
    (
        optional_column("Volt", "v", "voltage_v"),
        optional_column("Curr", "A", "current_a"),
        optional_column("SoC", "-", "charge"),
        optional_column("Sun", "W", "solar_w"),
        optional_column("Load", "W", "load_w"),
        float_column("ESun", "J", "solar.energy_j"),
        float_column("ELod", "J", "load.energy_j"),
        float_column("EIn", "J", "charged.energy_j"),
        float_column("EOut", "J", "discharged.energy_j"),
    ),
    _ignore_record,
)
WIND: Final = Row(
    198,
    "WNDG",
    (
        optional_column("Spd", "n", "wind_m_s"),
        optional_column("Dir", "r", "from_rad"),
        optional_column("Mean", "n", "mean_m_s"),
        optional_column("MDir", "r", "mean_from_rad"),
        optional_column("Sd", "n", "sd_m_s"),
        optional_column("Gust", "n", "gust_m_s"),
        optional_column("AppS", "n", "apparent_m_s"),
        optional_column("AppA", "r", "apparent_rad"),
    ),
    _ignore_record,
)
DEAD_RECKONING: Final = Row(
    192,
    "RKN",
    (
        float_column("Lat", "r", "latitude_rad"),
        float_column("Lng", "r", "longitude_rad"),
        float_column("VN", "n", "north_m_s"),
        float_column("VE", "n", "east_m_s"),
        float_column("Sd", "m", "sd_m"),
        float_column("For", "s", "time_since_fix_s"),
    ),
    _ignore_record,
)
RUDDER_ESTIMATE: Final = Row(
    194,
    "RUDE",  # only while the rudder angle is not measured
    (optional_column("Rud", "r", "rudder_estimate_rad"), float_column("RudC", "r", "rudder_command_rad")),
    _ignore_record,
)
TYPES: Final = (
    NAVIGATION.type,
    ESTIMATE.type,
    GUIDANCE.type,
    WATER.type,
    ENERGY.type,
    SUPPLY.type,
    DEAD_RECKONING.type,
    RUDDER_ESTIMATE.type,
    WIND.type,
)


def encode_snapshot(snapshot: Snapshot) -> bytes:
    """Encode the log messages of a snapshot."""
    t_s = snapshot.t_s
    data = NAVIGATION.pack(t_s, snapshot)
    if snapshot.rudder_estimate_rad is not None:
        data += RUDDER_ESTIMATE.pack(t_s, snapshot)
    if snapshot.estimate is not None:
        data += ESTIMATE.pack(t_s, snapshot.estimate)
    if snapshot.tick % SLOW_INTERVAL_TICKS:
        return data
    data += GUIDANCE.pack(t_s, snapshot)
    if snapshot.energy is not None:
        data += ENERGY.pack(t_s, snapshot.energy)
    if snapshot.dead_reckoning is not None:
        data += DEAD_RECKONING.pack(t_s, snapshot.dead_reckoning)
    if snapshot.wind is not None and snapshot.wind_ok:
        data += WIND.pack(t_s, snapshot.wind)
    if snapshot.power is not None:
        data += SUPPLY.pack(t_s, snapshot.power)
    return data if snapshot.water is None else data + WATER.pack(t_s, snapshot.water)
