"""Derived quantities in the log. A replay does not read them; it computes them again. Units as in schema.py."""

from __future__ import annotations

from typing import Final

from firmware_py.common.reports import Snapshot
from firmware_py.log.message_rows import Row, flag, maybe, real, whole

GUIDANCE_TICKS: Final = 10  # interval of the messages that change slowly, which are all but NAV and EST


def _ignore_record() -> None:
    """Return no record, since a replay computes it again."""


NAVIGATION: Final = Row(
    148,
    "NAV",
    (
        maybe("Hdg", "r", "heading_rad"),
        flag("HdgOk", "heading_ok"),
        maybe("YawR", "E", "yaw_rate_rad_s"),
        maybe("Roll", "r", "roll_rad"),
        maybe("Pitch", "r", "pitch_rad"),
        maybe("Goal", "r", "goal_heading_rad"),
        maybe("Err", "r", "heading_error_rad"),
        maybe("Brg", "r", "bearing_rad"),
        maybe("Dist", "m", "distance_m"),
        flag("PosOk", "position_ok"),
        real("Soft", "-", "gain_reduction"),
    ),
    _ignore_record,
)
GUIDANCE: Final = Row(
    153,
    "GDN",
    (
        whole("Do", "B", "navigation.activity"),
        maybe("Lat", "r", "navigation.target_latitude_rad"),
        maybe("Lng", "r", "navigation.target_longitude_rad"),
        maybe("Rad", "m", "navigation.radius_m"),
        maybe("XTrk", "m", "navigation.cross_track_m"),
        flag("Arr", "navigation.arrived"),
        maybe("Fnc", "m", "navigation.fence_margin_m"),
        whole("MSt", "B", "mission.state"),
        maybe("MItm", "-", "mission.index"),
    ),
    _ignore_record,
)
WATER: Final = Row(
    154,
    "WTR",
    (
        real("U", "n", "speed_m_s"),
        real("USd", "n", "speed_sd_m_s"),
        real("CN", "n", "current_north_m_s"),
        real("CE", "n", "current_east_m_s"),
        real("CSd", "n", "current_sd_m_s"),
        real("Lee", "r", "leeway_rad"),
        real("LSd", "r", "leeway_sd_rad"),
        flag("Strg", "too_strong"),
    ),
    _ignore_record,
)
ESTIMATE: Final = Row(
    151,
    "EST",
    (
        real("Hdg", "r", "heading_rad"),
        real("HSd", "r", "heading_sd_rad"),
        real("YawR", "E", "yaw_rate_rad_s"),
        whole("Src", "B", "source"),
        real("Bias", "r", "bias_rad"),
        real("BSd", "r", "bias_sd_rad"),
        real("WT", "s", "wave_period_s"),
        real("WSd", "r", "wave_sd_rad"),
        real("U", "n", "speed_m_s"),
        real("CN", "n", "current_north_m_s"),
        real("CE", "n", "current_east_m_s"),
        real("In", "r", "innovation_rad"),
        real("ISd", "r", "innovation_sd_rad"),
        real("I2", "-", "innovation_square"),
        real("P2", "-", "prediction_square"),
    ),
    _ignore_record,
)
ENERGY: Final = Row(
    155,
    "ENRG",
    (
        real("Trav", "r", "travel_rad"),
        whole("Rev", "Q", "reversals"),
        real("Enrg", "J", "energy_j"),
        real("TrvH", "r", "travel_rad_per_h"),
        real("RevH", "-", "reversals_per_h"),
        maybe("Pow", "W", "power_w"),
        flag("Rest", "resting"),
    ),
    _ignore_record,
)
SUPPLY: Final = Row(
    158,
    "SUPL",
    (
        maybe("Volt", "v", "voltage_v"),
        maybe("Curr", "A", "current_a"),
        maybe("SoC", "-", "charge"),
        maybe("Sun", "W", "solar_w"),
        maybe("Load", "W", "load_w"),
        real("ESun", "J", "solar.energy_j"),
        real("ELod", "J", "load.energy_j"),
        real("EIn", "J", "charged.energy_j"),
        real("EOut", "J", "discharged.energy_j"),
    ),
    _ignore_record,
)
DEAD_RECKONING: Final = Row(
    192,
    "RKN",
    (
        real("Lat", "r", "latitude_rad"),
        real("Lng", "r", "longitude_rad"),
        real("VN", "n", "north_m_s"),
        real("VE", "n", "east_m_s"),
        real("Sd", "m", "sd_m"),
        real("For", "s", "time_since_fix_s"),
    ),
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
)


def snapshot_bytes(snapshot: Snapshot) -> bytes:
    """Encode the log messages of a snapshot."""
    t_s = snapshot.t_s
    data = NAVIGATION.pack(t_s, snapshot)
    if snapshot.estimate is not None:
        data += ESTIMATE.pack(t_s, snapshot.estimate)
    if snapshot.tick % GUIDANCE_TICKS:
        return data
    data += GUIDANCE.pack(t_s, snapshot)
    if snapshot.energy is not None:
        data += ENERGY.pack(t_s, snapshot.energy)
    if snapshot.dead_reckoning is not None:
        data += DEAD_RECKONING.pack(t_s, snapshot.dead_reckoning)
    if snapshot.power is not None:
        data += SUPPLY.pack(t_s, snapshot.power)
    return data if snapshot.water is None else data + WATER.pack(t_s, snapshot.water)
