"""What a status tells of the boat, section by section, in the units of whoever reads it ashore."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.records import CalibrationState
from firmware_py.common.reports import Snapshot, SwingReport
from firmware_py.common.vessels import Vessel
from firmware_py.system.readings import Values, position_values, rounded, rudder_values

MAX_VESSELS_LISTED = 5


def _rudder(snapshot: Snapshot) -> Values:
    return {
        "angle_deg": rounded(snapshot.rudder_rad, 2, degrees),
        "command_deg": rounded(snapshot.rudder_command_rad, 2, degrees),
        "ok": snapshot.rudder_ok,
        "helm_softness": rounded(snapshot.gain_reduction, 2),
        **({} if snapshot.servo is None else rudder_values(snapshot.servo)),
        "age_s": None if snapshot.servo is None else rounded(snapshot.t_s - snapshot.servo.t_s, 1),
    }


def _position(snapshot: Snapshot) -> Values:
    values: Values = {"ok": snapshot.position_ok}
    if snapshot.position is not None:
        values |= {"age_s": rounded(snapshot.t_s - snapshot.position.t_s, 1), **position_values(snapshot.position)}
    if (dead_reckoning := snapshot.dead_reckoning) is not None:
        values |= {
            "reckoned_lat_deg": rounded(dead_reckoning.latitude_rad, 5, degrees),
            "reckoned_lon_deg": rounded(dead_reckoning.longitude_rad, 5, degrees),
            "reckoned_sd_m": rounded(dead_reckoning.sd_m, 0),
            "reckoned_s": rounded(dead_reckoning.lasted_s, 0),
        }
    return values


def _navigation(snapshot: Snapshot) -> Values:
    navigation, mission = snapshot.navigation, snapshot.mission
    return {
        "activity": navigation.activity.name,
        "target_lat_deg": rounded(navigation.target_latitude_rad, 7, degrees),
        "target_lon_deg": rounded(navigation.target_longitude_rad, 7, degrees),
        "radius_m": rounded(navigation.radius_m, 1),
        "distance_m": rounded(snapshot.distance_m, 1),
        "bearing_deg": rounded(snapshot.bearing_rad, 1, compass_degrees),
        "cross_track_m": rounded(navigation.cross_track_m, 1),
        "fence_margin_m": rounded(navigation.fence_margin_m, 1),
        "mission": mission.state.name,
        "item": None if mission.index is None else mission.first + mission.index,
        "items": mission.count,
        "first_item": mission.first,
    }


def _home(snapshot: Snapshot) -> Values:
    home = snapshot.home
    if home is None:
        return {}
    return {"lat_deg": rounded(home.latitude_rad, 7, degrees), "lon_deg": rounded(home.longitude_rad, 7, degrees)}


def _estimate(snapshot: Snapshot) -> Values:
    estimate, water = snapshot.estimate, snapshot.water
    values: Values = {}
    if estimate is not None:
        values = {
            "heading_source": ("compass", "compass_b", "course", "nothing")[estimate.source],
            "heading_deg": rounded(estimate.heading_rad, 2, compass_degrees),
            "heading_sd_deg": rounded(estimate.heading_sd_rad, 2, degrees),
            "rudder_bias_deg": rounded(estimate.bias_rad, 2, degrees),
            "wave_period_s": rounded(estimate.wave_period_s, 1),
            "wave_sd_deg": rounded(estimate.wave_sd_rad, 2, degrees),
            "compass_noise_deg": rounded(estimate.compass_noise_rad, 2, degrees),
            "yaw_diffusion_deg2_s": rounded(estimate.yaw_diffusion_rad2_s, 3, lambda value: degrees(degrees(value))),
            "prediction_square": rounded(estimate.prediction_square, 2),
            "innovation_square": rounded(estimate.innovation_square, 2),
        }
    if water is not None:
        values |= {
            "speed_m_s": rounded(water.speed_m_s, 3),
            "speed_sd_m_s": rounded(water.speed_sd_m_s, 3),
            "current_m_s": rounded(math.hypot(water.current_north_m_s, water.current_east_m_s), 3),
            "current_to_deg": rounded(math.atan2(water.current_east_m_s, water.current_north_m_s), 0, compass_degrees),
            "current_sd_m_s": rounded(water.current_sd_m_s, 3),
            "leeway_deg": rounded(water.leeway_rad, 1, degrees),
        }
    return values


def _energy(snapshot: Snapshot) -> Values:
    energy = snapshot.energy
    if energy is None:
        return {}
    return {
        "steering_wh": rounded(energy.energy_j / 3600.0, 3),
        "servo_power_w": rounded(energy.power_w, 2),
        "travel_deg_per_h": rounded(energy.travel_rad_per_h, 0, degrees),
        "reversals_per_h": rounded(energy.reversals_per_h, 0),
        "servo_resting": energy.resting,
    }


def _power(snapshot: Snapshot) -> Values:
    power = snapshot.power
    if power is None:
        return {}
    flows = {"solar": power.solar, "load": power.load, "charged": power.charged, "discharged": power.discharged}
    return {
        "saving": ("nothing", "saves", "keeps heading")[snapshot.saving],
        "battery_v": rounded(power.voltage_v, 2),
        "battery_a": rounded(power.current_a, 2),
        "charge_percent": rounded(power.charge, 1, lambda charge: 100.0 * charge),
        "battery_c": rounded(power.temperature_c, 0),
        "solar_w": rounded(power.solar_w, 1),
        "load_w": rounded(power.load_w, 2),
        **{f"{name}_wh": rounded(flow.energy_j / 3600.0, 2) for name, flow in flows.items() if flow.measured_s},
    }


_COEFFICIENTS = ("a_deg", "b_deg", "c_deg", "d_deg", "e_deg")


def calibration(swing: SwingReport) -> Values:
    """Return a swing of the compass under way and its proposal; nothing without one."""
    if swing.state is CalibrationState.NONE:
        return {}
    return {
        "compass": "proposal waits" if swing.state is CalibrationState.DONE else "under way",
        "percent": swing.percent,
        "minutes": swing.minutes,
        "sectors": swing.sectors.bit_count(),
        **{name: rounded(value, 2, degrees) for name, value in zip(_COEFFICIENTS, swing.found_rad, strict=False)},
        "sd_deg": rounded(swing.sd_rad, 2, degrees),
        "in_force_off_deg": rounded(swing.off_rad, 2, degrees),
        "residual_before_deg": rounded(swing.residual_before_rad, 2, degrees),
        "residual_after_deg": rounded(swing.residual_after_rad, 2, degrees),
    }


def _traffic(snapshot: Snapshot) -> Values:
    """Return the number of vessels, and the most important ones: in distress, coming near, then the nearest."""
    traffic = snapshot.traffic
    if traffic is None:
        return {}
    seen = [vessel for vessel in traffic.vessels if vessel.distance_m is not None]
    seen.sort(key=lambda vessel: (not vessel.distress, vessel.near_s is None, vessel.distance_m))
    return {
        "vessels": len(traffic.vessels),
        "no_room_for": traffic.rejected,
        "aside_deg": rounded(traffic.aside_rad, 0, compass_degrees),
        "nearest": [_vessel(vessel, snapshot.t_s) for vessel in seen[:MAX_VESSELS_LISTED]],
    }


def _vessel(vessel: Vessel, now_s: float) -> Values:
    return {
        "mmsi": vessel.mmsi,
        "title": vessel.title,
        "age_s": rounded(now_s - vessel.position.t_s, 0),
        "distance_m": rounded(vessel.distance_m, 0),
        "bearing_deg": rounded(vessel.bearing_rad, 0, compass_degrees),
        "sog_m_s": rounded(vessel.position.speed_m_s, 1),
        "cog_deg": rounded(vessel.position.course_rad, 0, compass_degrees),
        "cpa_m": rounded(vessel.cpa_m, 0),
        "cpa_in_s": rounded(vessel.cpa_in_s, 0),
        "near": vessel.near_s is not None,
    }


# A part of the snapshot that is to be seen is a row here: its name in the JSON, and what makes it.
SECTIONS: Mapping[str, Callable[[Snapshot], Values]] = {
    "rudder": _rudder,
    "position": _position,
    "navigation": _navigation,
    "home": _home,
    "estimate": _estimate,
    "energy": _energy,
    "power": _power,
    "traffic": _traffic,
}
