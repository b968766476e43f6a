"""Table of other vessels, of limited size and checked every two seconds; each approaching vessel is reported once.

AIS reports may be wrong or forged. A position that jumps is not used at once. A full table keeps the vessels that could
arrive first. Several near vessels are reported one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import compass_degrees, degrees, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceHealth, DeviceRole, Event, Severity
from firmware_py.common.vessels import Vessel, VesselPosition, VesselReport, is_distress_number, merge
from firmware_py.guidance.approach import Velocity, relative_motion

MAX_VESSELS = 100
# For a moving vessel, and for a vessel at rest, which reports every three minutes; some reports are lost.
MAX_SILENCE_S, MAX_SILENCE_AT_REST_S = 600.0, 1800.0
CHECK_INTERVAL_S = 2.0
REPORT_INTERVAL_S = 5.0  # between reports of two vessels
REPEAT_INTERVAL_S = 600.0  # between reports of a receiver problem or of a distress beacon
MAX_JUMP_M, MAX_SPEED_M_S = 500.0, 60.0  # maximum position error of a valid report, and speed of the fastest craft
CONFIRMATIONS = 3  # consistent positions after which a jump is accepted
# A near vessel is no longer near if it moves away beyond PASSED_FACTOR near distances, or if its closest approach
# exceeds CLEAR_FACTOR near distances.
PASSED_FACTOR, CLEAR_FACTOR = 1.1, 3.0
OWN_SPEED_M_S = 0.5  # of the boat, for the time in which a vessel could arrive
# Maximum distance and minimum travel of the transponder of the boat.
ECHO_DISTANCE_M, ECHO_TRAVEL_M = 40.0, 50.0


class TrafficSettings(msgspec.Struct, frozen=True):
    """Distance and time of a near vessel, maximum speed of a vessel at rest, and its near distance."""

    near_m: float
    near_s: float
    rest_near_m: float
    max_rest_speed_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> TrafficSettings:
        """Read the settings from the parameters."""
        return cls(
            near_m=parameters["AIS_NEAR_M"],
            near_s=parameters["AIS_NEAR_S"],
            rest_near_m=parameters["AIS_STILL_M"],
            max_rest_speed_m_s=parameters["AIS_STILL_M_S"],
        )

    @property
    def horizon_s(self) -> float:
        """Prediction time of the closest approach."""
        return 2.0 * self.near_s

    def limit_m(self, position: VesselPosition) -> float:
        """Return the distance below which a vessel is near."""
        return self.near_m if self._is_moving(position) else self.rest_near_m

    def max_silence_s(self, position: VesselPosition) -> float:
        """Return the time without reports after which a vessel is removed."""
        return MAX_SILENCE_S if self._is_moving(position) else MAX_SILENCE_AT_REST_S

    def _is_moving(self, position: VesselPosition) -> bool:
        return position.speed_m_s is not None and position.speed_m_s >= self.max_rest_speed_m_s


class TrafficState(msgspec.Struct, frozen=True):
    """Table of vessels, times of the last check and report, and the number of vessels rejected from a full table.

    `unplaced_mmsi` and `unplaced_s` belong to the last reported distress beacon without a position.
    """

    vessels: tuple[Vessel, ...] = ()
    checked_s: float | None = None
    reported_s: float | None = None
    receiver_reported_s: float | None = None
    rejected: int = 0
    unplaced_mmsi: int = 0
    unplaced_s: float | None = None

    @property
    def near(self) -> bool:
        """Return whether a vessel is near."""
        return any(vessel.near_s is not None for vessel in self.vessels)


class OwnMotion(msgspec.Struct, frozen=True):
    """Position and velocity of the boat over ground; in avoidance also on the unchanged course and on the way back."""

    place: Place
    velocity_m_s: Velocity
    unchanged_m_s: Velocity | None = None
    return_m_s: Velocity | None = None


def update(
    settings: TrafficSettings, state: TrafficState, reports: Sequence[VesselReport], own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Add the reports of a tick, and check the table every CHECK_INTERVAL_S; return the state and the events."""
    events: tuple[Event, ...] = ()
    if reports:
        state = _apply_reports(state, reports, own, now_s)
        state, events = _report_unplaced(state, reports, now_s)
    if state.checked_s is not None and 0.0 <= now_s - state.checked_s < CHECK_INTERVAL_S:
        return state, events
    state, distress = _report_distress(replace(state, checked_s=now_s), own, now_s)
    state, near = _check_vessels(settings, state, own, now_s)
    return state, (*events, *distress, *near)


def receiver_events(
    state: TrafficState, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Return the problems of the receiver as events, at most one in REPEAT_INTERVAL_S."""
    texts = [device.text for device in devices if device.role is DeviceRole.AIS and device.text]
    if not texts or (state.receiver_reported_s is not None and now_s - state.receiver_reported_s < REPEAT_INTERVAL_S):
        return state, ()
    return replace(state, receiver_reported_s=now_s), (Event(Severity.NOTICE, f"AIS: {texts[-1]}"),)


def _apply_reports(
    state: TrafficState, reports: Sequence[VesselReport], own: OwnMotion | None, now_s: float
) -> TrafficState:
    vessels = {vessel.mmsi: vessel for vessel in state.vessels}
    rejected = state.rejected
    for report in reports:
        vessel = vessels.get(report.mmsi)
        if not isinstance(report, VesselPosition):
            if vessel is not None:  # without a position; the identity is sent again within minutes
                identity = report if vessel.identity is None else merge(vessel.identity, report)
                vessels[report.mmsi] = replace(vessel, identity=identity)
        elif vessel is not None:
            vessels[report.mmsi] = _update_position(vessel, report)
        else:
            rejected += _add_vessel(vessels, Vessel(report), own, now_s)
    return replace(state, vessels=tuple(vessels.values()), rejected=rejected)


def _add_vessel(vessels: dict[int, Vessel], vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Add a new vessel to the table; return whether a vessel was rejected because the table is full."""
    if own is not None:
        vessel = _update_bearing(vessel, own, now_s)
    is_full = len(vessels) >= MAX_VESSELS
    if is_full:
        last = max(vessels.values(), key=_arrival_time_s)
        if _arrival_time_s(vessel) >= _arrival_time_s(last):
            return True
        del vessels[last.mmsi]
    vessels[vessel.mmsi] = vessel
    return is_full


def _arrival_time_s(vessel: Vessel) -> float:
    """Return the time in which a vessel could arrive; it is -1 for distress beacons and 0 for near vessels."""
    if vessel.near_s is not None:
        return 0.0
    if vessel.is_distress_beacon:
        return -1.0
    if vessel.distance_m is None:
        return math.inf
    return vessel.distance_m / ((vessel.position.speed_m_s or 0.0) + OWN_SPEED_M_S)


def _update_position(vessel: Vessel, report: VesselPosition) -> Vessel:
    """Return a vessel with a new position; an impossible position is used only after CONFIRMATIONS reports."""
    if _is_reachable(vessel.position, report):
        return replace(vessel, position=report, doubted=None, doubts=0)
    doubts = vessel.doubts + 1 if vessel.doubted is not None and _is_reachable(vessel.doubted, report) else 1
    if doubts >= CONFIRMATIONS:
        return replace(vessel, position=report, doubted=None, doubts=0)
    return replace(vessel, doubted=report, doubts=doubts)


def _is_reachable(start: VesselPosition, end: VesselPosition) -> bool:
    """Return whether a vessel can have moved from one position to another."""
    place = Place(start.latitude_rad, start.longitude_rad)
    distance_m, _ = place.distance_and_bearing(Place(end.latitude_rad, end.longitude_rad))
    return distance_m <= MAX_JUMP_M + MAX_SPEED_M_S * max(0.0, end.t_s - start.t_s)


def _check_vessels(
    settings: TrafficSettings, state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    recent = [
        vessel for vessel in state.vessels if now_s - vessel.position.t_s <= settings.max_silence_s(vessel.position)
    ]
    if own is None:
        reset = (replace(vessel, distance_m=None, bearing_rad=None, cpa_m=None, cpa_in_s=None) for vessel in recent)
        return replace(state, vessels=tuple(reset)), ()
    vessels = [_update_approach(settings, _update_echo_status(vessel, own, now_s), own, now_s) for vessel in recent]
    state = replace(state, vessels=tuple(vessels))
    echoes = tuple(
        Event(Severity.NOTICE, f"{vessel.title}: own echo, ignored")
        for vessel, previous in zip(vessels, recent, strict=True)
        if vessel.own and not previous.own
    )
    if state.reported_s is not None and now_s - state.reported_s < REPORT_INTERVAL_S:
        return state, echoes
    others = (index for index, vessel in enumerate(vessels) if vessel.near_s is None and vessel.is_other_vessel)
    approaching = [index for index in others if _is_approaching(settings, vessels[index], own, now_s)]
    if not approaching:
        return state, echoes
    first_index = min(approaching, key=lambda index: vessels[index].cpa_in_s or 0.0)
    vessels[first_index] = replace(vessels[first_index], near_s=now_s)
    event = Event(Severity.WARNING, near_text(vessels[first_index]))
    return replace(state, vessels=tuple(vessels), reported_s=now_s), (*echoes, event)


def _update_echo_status(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its echo status: whether it is the transponder of the boat itself.

    This is so if it has moved by ECHO_TRAVEL_M since it came within ECHO_DISTANCE_M of the boat.
    """
    if now_s - vessel.position.t_s > CHECK_INTERVAL_S:
        return vessel
    place = Place(vessel.position.latitude_rad, vessel.position.longitude_rad)
    if own.place.distance_and_bearing(place)[0] > ECHO_DISTANCE_M:
        return vessel if vessel.beside_s is None else replace(vessel, beside_s=None, own=False)
    if vessel.beside_s is None:
        return replace(vessel, beside_s=vessel.position.t_s, beside_rad=(place.latitude_rad, place.longitude_rad))
    if vessel.own or place.distance_and_bearing(Place(*vessel.beside_rad))[0] < ECHO_TRAVEL_M:
        return vessel
    return replace(vessel, own=True)


def _report_distress(
    state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report the distress beacon whose last event is the oldest: by bearing and distance if known, else by position."""
    vessels = list(state.vessels)
    due = [
        index
        for index, vessel in enumerate(vessels)
        if vessel.is_distress_beacon and _is_report_due(vessel, own, now_s)
    ]
    if not due:
        return state, ()
    first_index = min(due, key=lambda index: _last_report_s(vessels[index]))
    vessel = replace(vessels[first_index], reported_s=now_s, bearing_reported=own is not None)
    vessels[first_index] = vessel
    if own is None:
        position = vessel.position
        latitude_deg, longitude_deg = degrees(position.latitude_rad), degrees(position.longitude_rad)
        text = f"Distress beacon {vessel.mmsi:09d}: at {latitude_deg:.4f}, {longitude_deg:.4f}"
    else:
        offset = _update_bearing(vessel, own, now_s)
        bearing_deg = compass_degrees(offset.bearing_rad or 0.0)
        text = f"Distress beacon {vessel.mmsi:09d}: {offset.distance_m:.0f} m, bearing {bearing_deg:03.0f} deg"
    return replace(state, vessels=tuple(vessels)), (Event(Severity.CRITICAL, text),)


def _last_report_s(vessel: Vessel) -> float:
    return -math.inf if vessel.reported_s is None else vessel.reported_s


def _is_report_due(vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Return whether a beacon is new, has had no event for REPEAT_INTERVAL_S, or has a bearing for the first time."""
    if vessel.reported_s is None:
        return True
    return (own is not None and not vessel.bearing_reported) or now_s - vessel.reported_s >= REPEAT_INTERVAL_S


def _report_unplaced(
    state: TrafficState, reports: Sequence[VesselReport], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report a distress beacon without a position."""
    placed_mmsis = {vessel.mmsi for vessel in state.vessels}
    mmsi = next(
        (report.mmsi for report in reports if is_distress_number(report.mmsi) and report.mmsi not in placed_mmsis), None
    )
    if mmsi is None:
        return state, ()
    interval_s = REPEAT_INTERVAL_S if mmsi == state.unplaced_mmsi else REPORT_INTERVAL_S
    if state.unplaced_s is not None and now_s - state.unplaced_s < interval_s:
        return state, ()
    event = Event(Severity.CRITICAL, f"Distress beacon {mmsi:09d}: no position yet")
    return replace(state, unplaced_mmsi=mmsi, unplaced_s=now_s), (event,)


def _update_bearing(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its distance and bearing."""
    offset = relative_motion(own.place, vessel.position, now_s)
    bearing_rad = wrap_two_pi(math.atan2(offset.east_m, offset.north_m))
    return replace(vessel, distance_m=math.hypot(offset.north_m, offset.east_m), bearing_rad=bearing_rad)


def _update_approach(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its present distance and closest approach; a vessel that has passed is no longer near."""
    offset = relative_motion(own.place, vessel.position, now_s)
    cpa_m, cpa_in_s = offset.closest_approach(own.velocity_m_s, settings.horizon_s)
    distance_m = math.hypot(offset.north_m, offset.east_m)
    limit_m = settings.limit_m(vessel.position)
    is_clear = (cpa_in_s <= 0.0 and distance_m > PASSED_FACTOR * limit_m) or cpa_m > CLEAR_FACTOR * limit_m
    if own.unchanged_m_s is not None:  # in avoidance, the vessel must also have passed the unchanged course
        is_clear = is_clear and offset.closest_approach(own.unchanged_m_s, settings.horizon_s)[1] <= 0.0
    if own.return_m_s is not None:  # the way back must also stay clear of it
        is_clear = is_clear and offset.closest_approach(own.return_m_s, settings.horizon_s)[0] > PASSED_FACTOR * limit_m
    return replace(
        vessel,
        distance_m=distance_m,
        bearing_rad=wrap_two_pi(math.atan2(offset.east_m, offset.north_m)),
        cpa_m=cpa_m,
        cpa_in_s=cpa_in_s,
        near_s=None if is_clear or not vessel.is_other_vessel else vessel.near_s,
    )


def _is_approaching(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> bool:
    """Return whether the closest approach within the near time is below the near distance."""
    limit_m = settings.limit_m(vessel.position)
    if vessel.cpa_m is None or vessel.cpa_m > limit_m:
        return False
    cpa_m, _ = relative_motion(own.place, vessel.position, now_s).closest_approach(own.velocity_m_s, settings.near_s)
    return cpa_m <= limit_m


def near_text(vessel: Vessel) -> str:
    """Return the warning of a near vessel: closest approach, its time and the present bearing."""
    minutes, bearing_deg = (vessel.cpa_in_s or 0.0) / 60.0, compass_degrees(vessel.bearing_rad or 0.0)
    return f"{vessel.title}: closest {vessel.cpa_m or 0.0:.0f} m in {minutes:.0f} min, bearing {bearing_deg:.0f} deg"
