"""The status of a running autopilot, assembled once a second and written to the status file."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import asdict, fields

from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.records import CalibrationState, DeviceHealth, DeviceRole
from firmware_py.common.reports import Output, Snapshot, SwingReport
from firmware_py.common.vessels import Vessel
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.system.readings import Values, device_values, position_values, rounded, rudder_values
from firmware_py.system.status_file import StatusFile

INTERVAL_S = 1.0
MAX_EVENTS = 30  # the newest events are listed
RATE_INTERVALS = 10  # over which the rate of a device is averaged
MAX_LISTED_VESSELS = 5
_PEER_FIELDS = tuple(field.name for field in fields(PeerStatus))


def _rudder(snapshot: Snapshot) -> Values:
    return {
        "angle_deg": rounded(snapshot.rudder_rad, 2, degrees),
        "estimated_deg": rounded(snapshot.rudder_estimate_rad, 2, degrees),
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
            "reckoned_s": rounded(dead_reckoning.time_since_fix_s, 0),
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
        "item": None if mission.index is None else mission.first_item_number + mission.index,
        "items": mission.count,
        "first_item": mission.first_item_number,
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
        "saving": ("nothing", "saves", "keeps heading")[snapshot.power_saving_level],
        "battery_v": rounded(power.voltage_v, 2),
        "battery_a": rounded(power.current_a, 2),
        "charge_percent": rounded(power.charge, 1, lambda charge: 100.0 * charge),
        "battery_c": rounded(power.temperature_c, 0),
        "solar_w": rounded(power.solar_w, 1),
        "load_w": rounded(power.load_w, 2),
        **{f"{name}_wh": rounded(flow.energy_j / 3600.0, 2) for name, flow in flows.items() if flow.measured_s},
    }


# Coefficients A to E of the compass deviation.
_COEFFICIENTS = ("a_deg", "b_deg", "c_deg", "d_deg", "e_deg")


def calibration_values(swing: SwingReport) -> Values:
    """Return the state and the result of a compass swing; empty without one."""
    if swing.state is CalibrationState.NONE:
        return {}
    return {
        "compass": "proposal waits" if swing.state is CalibrationState.DONE else "under way",
        "percent": swing.percent,
        "minutes": swing.minutes,
        "sectors": swing.sectors.bit_count(),
        **{name: rounded(value, 2, degrees) for name, value in zip(_COEFFICIENTS, swing.estimated_rad, strict=False)},
        "sd_deg": rounded(swing.sd_rad, 2, degrees),
        "in_force_off_deg": rounded(swing.max_change_rad, 2, degrees),
        "residual_before_deg": rounded(swing.residual_before_rad, 2, degrees),
        "residual_after_deg": rounded(swing.residual_after_rad, 2, degrees),
    }


def _wind(snapshot: Snapshot) -> Values:
    wind = snapshot.wind
    if wind is None:
        return {}
    return {
        "ok": snapshot.wind_ok,
        "age_s": rounded(snapshot.t_s - wind.t_s, 1),
        "wind_m_s": rounded(wind.wind_m_s, 1),
        "wind_from_deg": rounded(wind.from_rad, 0, compass_degrees),
        "mean_wind_m_s": rounded(wind.mean_m_s, 1),
        "mean_wind_from_deg": rounded(wind.mean_from_rad, 0, compass_degrees),
        "gust_m_s": rounded(wind.gust_m_s, 1),
        "apparent_wind_m_s": rounded(wind.apparent_m_s, 1),
        "apparent_wind_deg": rounded(wind.apparent_rad, 0, compass_degrees),
    }


def _depth(snapshot: Snapshot) -> Values:
    depth = snapshot.depth
    if depth is None:
        return {}
    return {
        "ok": snapshot.depth_ok,
        "age_s": rounded(snapshot.t_s - depth.t_s, 1),
        "depth_m": rounded(depth.depth_m, 1),
    }


def _traffic(snapshot: Snapshot) -> Values:
    """Return the number of vessels and the first ones in the order: in distress, approaching, nearest."""
    traffic = snapshot.traffic
    if traffic is None:
        return {}
    vessels_by_urgency = [vessel for vessel in traffic.vessels if vessel.distance_m is not None]
    vessels_by_urgency.sort(
        key=lambda vessel: (not vessel.is_distress_beacon, vessel.near_s is None, vessel.distance_m)
    )
    return {
        "vessels": len(traffic.vessels),
        "no_room_for": traffic.rejected,
        "aside_deg": rounded(traffic.aside_rad, 0, compass_degrees),
        "nearest": [_vessel(vessel, snapshot.t_s) for vessel in vessels_by_urgency[:MAX_LISTED_VESSELS]],
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


# Sections of the JSON: name, and the function that returns the values.
SECTIONS: Mapping[str, Callable[[Snapshot], Values]] = {
    "rudder": _rudder,
    "position": _position,
    "navigation": _navigation,
    "home": _home,
    "estimate": _estimate,
    "energy": _energy,
    "power": _power,
    "wind": _wind,
    "depth": _depth,
    "traffic": _traffic,
}


class StatusSources(msgspec.Struct, frozen=True):
    """The sources of a status in addition to the snapshot.

    `about` contains values that are constant while the process runs, `ports` driver and port of each device.
    """

    about: Mapping[str, Any]
    ports: Mapping[DeviceRole, tuple[str, str]]
    devices: Callable[[], Mapping[DeviceRole, DeviceHealth]]
    links: Callable[[float], Sequence[LinkStatus]]
    faults: Callable[[], LatchState]
    starts: Callable[[], int]  # boot count
    written: Callable[[], tuple[int, int]]  # versions of the state written since the start, and their bytes
    load: Callable[[], float]  # of the processor, 0 to 1
    utc_s: Callable[[], float]
    machine_s: Callable[[], float]
    swing: Callable[[], SwingReport]
    update: Callable[[], str]  # state of a version on trial or withdrawn; empty without one


class StatusReporter:
    """Writes the status every INTERVAL_S; an error is reported once and does not affect the loop."""

    def __init__(self, sources: StatusSources, file: StatusFile, report: Callable[[str], None]) -> None:
        """Store the sources, the file and the function that reports to the operator."""
        self._sources, self._file, self._report = sources, file, report
        self._due_s = -math.inf
        self._last_problem = ""
        self._events: deque[Values] = deque(maxlen=MAX_EVENTS)
        self._last_message: dict[
            DeviceRole, tuple[int, float]
        ] = {}  # number of messages and the time of its last increase
        self._counts: deque[tuple[float, Mapping[DeviceRole, int]]] = deque(maxlen=RATE_INTERVALS + 1)

    def update(self, output: Output, now_s: float) -> None:
        """Store the events of a tick, and write the status when it is due."""
        for event in output.events:
            self._events.append({"t_s": round(now_s, 1), "severity": int(event.severity), "text": event.text})
        if now_s < self._due_s:
            return
        self._due_s = now_s + INTERVAL_S
        try:
            self._file.write(json.dumps(self._status(output.snapshot, now_s), allow_nan=False).encode())
            self._last_problem = ""
        except Exception as error:  # noqa: BLE001 - the status must not end a voyage
            self._report_once(f"Status file not written: {getattr(error, 'strerror', None) or repr(error)}")

    def close(self) -> None:
        """Remove the status file."""
        self._file.remove()

    def _report_once(self, text: str) -> None:
        if text != self._last_problem:
            self._last_problem = text
            self._report(text)

    def _status(self, snapshot: Snapshot, now_s: float) -> Values:
        sources = self._sources
        versions, written_bytes = sources.written()
        return {
            **sources.about,
            "written_machine_s": round(sources.machine_s(), 3),
            "utc_s": round(sources.utc_s(), 3),
            "uptime_s": round(now_s, 1),
            "starts": sources.starts(),
            "update": sources.update(),
            **_condition(snapshot),
            "faults": _faults(snapshot, sources.faults()),
            "events": list(self._events),
            "plan_identities": list(snapshot.mission.identities),
            "devices": self._devices(now_s),
            **{name: values_of(snapshot) for name, values_of in SECTIONS.items()},
            "calibration": calibration_values(sources.swing()),
            "links": [link_values(link) for link in sources.links(now_s)],
            "state_written": {"versions": versions, "bytes": written_bytes},
            "loop": {
                "rate_hz": rounded(snapshot.rate_hz, 3),
                "ticks": snapshot.tick + 1,
                "skipped": snapshot.skipped_total,
                "late_ms": rounded(1e3 * snapshot.late_s, 3),
                "processor_percent": rounded(100.0 * sources.load(), 2),
            },
        }

    def _devices(self, now_s: float) -> list[Values]:
        devices = self._sources.devices()
        self._counts.append((now_s, {role: health.accepted for role, health in devices.items()}))
        first_s, first_counts = self._counts[0]
        rows = []
        for role, health in devices.items():
            if role is DeviceRole.LINK:
                continue  # the peers are listed in their own section
            driver, port = self._sources.ports.get(role, ("", ""))
            has_rate = role in self._sources.ports and role in first_counts and now_s > first_s
            rate_hz = max(0, health.accepted - first_counts[role]) / (now_s - first_s) if has_rate else None
            if role in self._sources.ports and health.accepted != self._last_message.get(role, (0, 0.0))[0]:
                self._last_message[role] = (health.accepted, now_s)
            values = device_values(role.name.lower(), driver, port, health, rate_hz)
            if role in self._last_message:
                values["age_s"] = round(now_s - self._last_message[role][1], 1)  # accurate to INTERVAL_S
            rows.append(values)
        return rows


def _condition(snapshot: Snapshot) -> Values:
    return {
        "mode": snapshot.mode.name,
        "armed": snapshot.armed,
        "arming_refused": snapshot.prearm_refusal,
        "goal_deg": rounded(snapshot.goal_heading_rad, 2, compass_degrees),
        "heading_deg": rounded(snapshot.heading_rad, 2, compass_degrees),
        "heading_ok": snapshot.heading_ok,
        "heading_age_s": rounded(snapshot.heading_age_s, 1),
        "error_deg": rounded(snapshot.heading_error_rad, 2, degrees),
        "yaw_rate_deg_s": rounded(snapshot.yaw_rate_rad_s, 3, degrees),
    }


def _faults(snapshot: Snapshot, latch: LatchState) -> list[Values]:
    return [
        {
            "fault": fault.name,
            "severity": row.severity.name.lower(),
            "text": row.text,
            "since_s": None if (since_s := latch.since_s[fault]) is None else round(snapshot.t_s - since_s, 1),
        }
        for fault, row in FAULTS.items()
        if snapshot.faults >> fault & 1
    ]


def link_values(link: LinkStatus) -> Values:
    """Return the values of a link, as in the status file."""
    peer_values = [{name: getattr(peer, name) for name in _PEER_FIELDS} for peer in link.peers]
    peers = [peer | {"heard_age_s": rounded(peer["heard_age_s"], 1)} for peer in peer_values]
    values: Values = {"url": link.url, "rates": link.rates, "hindrance": link.blocked_reason, "peers": peers}
    if (satellite := link.satellite) is not None:
        fields = asdict(satellite) | {"session_age_s": rounded(satellite.session_age_s, 0)}
        values["satellite"] = {
            "hindrance" if name == "blocked_reason" else name: field for name, field in fields.items()
        }
    return values
